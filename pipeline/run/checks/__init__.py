"""Whether a dataset and a machine are sound."""
