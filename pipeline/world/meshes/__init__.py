"""Mesh files of others as triangles with the colors that their files state."""
