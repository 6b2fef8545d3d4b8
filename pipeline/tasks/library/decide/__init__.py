"""The suite `decide`: tasks in which the motion alone does not say what to do."""
