"""Annotations of a dataset: optical flow, object masks, object features; keyed by content, computed
once, brought up to date.

`run.annotate` does the work, `options` says how, `store.find_stage` and `store.read_entry` read
results, `flow` serves inference.
"""
