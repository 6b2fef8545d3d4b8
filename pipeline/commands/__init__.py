"""The verbs of `domino-data`."""
