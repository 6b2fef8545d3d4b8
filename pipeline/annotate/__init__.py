"""Optical flow, object masks and features, keyed by content and computed once."""
