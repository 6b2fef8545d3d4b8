"""The verbs of `domino-data`, one module per kind of work."""
