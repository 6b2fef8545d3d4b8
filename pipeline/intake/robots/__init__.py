"""Robots of others, from their files."""
