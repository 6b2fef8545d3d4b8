"""Objects from mesh files."""
