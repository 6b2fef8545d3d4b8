"""The expert that knows only the past."""
