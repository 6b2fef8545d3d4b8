"""Runs jobs in this process or on Ray workers, and watches them."""
