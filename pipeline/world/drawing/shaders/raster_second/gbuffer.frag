#version 450
#extension GL_GOOGLE_include_directive : enable
#define SECOND_LOOK
#include "../common/lit.glsl"

// The engine blends targets of four components, which takes time; this one has three.
layout(location = 0) out vec3 outImage;

void main() {
  outImage = display(shade());
}
