"""Targets found in all frames of a corpus, for networks that have the place of theirs as an input
(`model.track`)."""
