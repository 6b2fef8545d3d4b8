"""Datasets joined, compared and cleaned."""
