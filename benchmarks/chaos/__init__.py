"""A build whose processes are killed at random, against the same build undisturbed."""
