"""Robots of others, from their files: what a URDF holds, where its arm should stand, what is
written, and whether it is sound."""
