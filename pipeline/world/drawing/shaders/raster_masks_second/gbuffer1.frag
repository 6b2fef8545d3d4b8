#version 450
#extension GL_GOOGLE_include_directive : enable
#define SECOND_LOOK
#include "../common/plane.glsl"

// The engine blends targets of four components, which takes time; this one has three.
layout(location = 0) out vec3 outImage;
layout(location = 1) out vec4 outBody;

void main() {
  outImage = display(shade());
  outBody = vec4(float(objectDataBuffer.body) / 255.0, 0.0, 0.0, 1.0);
}
