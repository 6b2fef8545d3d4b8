"""Sentences: templates, the checks that they must pass."""
