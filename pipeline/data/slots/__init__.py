"""Finished slots of a dataset."""
