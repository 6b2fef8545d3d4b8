#version 450
#extension GL_GOOGLE_include_directive : enable
#include "../common/interface.glsl"

layout(location = 0) out vec4 outBody;

void main() {
  outBody = vec4(float(objectDataBuffer.body) / 255.0, 0.0, 0.0, 1.0);
}
