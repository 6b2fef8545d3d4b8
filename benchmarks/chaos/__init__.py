"""A build under a seeded schedule of disturbances, against the same build undisturbed: `python -m benchmarks.chaos --help`."""
