"""Annotations of a dataset: optical flow, object masks, object features; keyed by content and
computed once."""
