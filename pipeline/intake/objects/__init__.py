"""Objects from mesh files: reading them, standing them up, cutting, grasping and writing their
directories."""
