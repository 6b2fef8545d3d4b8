#version 450
// Only the depth is wanted.
void main() {}
