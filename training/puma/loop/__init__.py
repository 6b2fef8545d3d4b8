"""Parts of the training loop (train.py): batches ahead of it, the directory of a run, and the
model card."""
