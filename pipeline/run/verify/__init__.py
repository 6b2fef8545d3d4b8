"""`domino-data verify`: re-check what a dataset promises, from the files alone, each file by itself."""
