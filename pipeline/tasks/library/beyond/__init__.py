"""The suite `beyond`: tasks whose targets move as the paper's do not, on belts, discs, ramps and
strings. One file each."""
