"""The scenes of an evaluation and the episodes that run in them."""
