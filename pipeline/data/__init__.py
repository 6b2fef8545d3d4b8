"""What is stored: recipes, datasets, episodes. No simulator is imported."""
