"""How the five robots of the package are drawn: `python -m scripts.robot_looks` writes the GLB
files of their directories again."""
