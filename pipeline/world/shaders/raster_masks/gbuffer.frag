#version 450
#extension GL_GOOGLE_include_directive : enable
#include "../common/lit.glsl"

layout(location = 0) out vec4 outPicture;
layout(location = 1) out vec4 outBody;

void main() {
  outPicture = vec4(display(shade()), 1.0);
  outBody = vec4(float(max(objectDataBuffer.body, 0)) / 255.0, 0.0, 0.0, 1.0);
}
