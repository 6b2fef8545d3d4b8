"""Policies written for other projects, in this process."""
