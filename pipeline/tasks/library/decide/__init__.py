"""The suite `decide`: tasks in which seeing the motion is not enough."""
