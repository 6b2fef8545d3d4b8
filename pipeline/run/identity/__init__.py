"""Keys: the code and packages of an artifact."""
