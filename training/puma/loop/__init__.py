"""Parts of the training loop (train.py): batches ahead of it, learning rates, validation, the
directory of a run, and the model card."""
