"""Pages and lists of robots and objects."""
