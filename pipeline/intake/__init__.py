"""Files of others become robots, objects and tasks of ours: readers, placement, checks, catalogue
pages."""
