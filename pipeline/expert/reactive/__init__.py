"""The expert that knows only the past: what it sees of the target, how it predicts, and how its
hand follows."""
