"""Objects from mesh files: reading, standing, cutting, grasping and writing them."""
