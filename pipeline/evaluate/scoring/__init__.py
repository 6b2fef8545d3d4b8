"""What an episode is worth: clocks, metrics, tables, comparisons."""
