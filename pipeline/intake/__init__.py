"""Others' files become robots, objects and tasks."""
