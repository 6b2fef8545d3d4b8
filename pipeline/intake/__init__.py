"""Files of others become robots, objects and tasks of ours."""
