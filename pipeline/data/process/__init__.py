"""Resource limits, and others' code within them."""
