"""What is stored: recipes, datasets, episodes. Opens anywhere; nothing of the simulator is
imported."""
