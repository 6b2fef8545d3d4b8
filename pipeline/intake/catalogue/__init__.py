"""Pages and lists of the robots and objects that exist."""
