"""Stored data: recipes, datasets, episodes; no simulator."""
