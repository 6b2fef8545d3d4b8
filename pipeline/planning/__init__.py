"""How an arm can move; nothing here knows the simulation or the expert."""
