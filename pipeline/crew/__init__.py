"""The workers of a run: this process, or Ray."""
