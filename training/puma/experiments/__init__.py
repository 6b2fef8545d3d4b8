"""Experiments of the DOMINO paper as commands, and its printed rows beside ours."""
