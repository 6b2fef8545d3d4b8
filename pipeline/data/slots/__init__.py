"""Finished slots of a dataset: the index, their files, and choosing among them."""
