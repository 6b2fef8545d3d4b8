"""What stands beside the road of a build: progress, metrics, early stop."""
