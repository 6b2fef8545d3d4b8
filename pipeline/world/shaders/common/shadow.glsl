// Depth only, as seen by the light whose matrices the engine binds.
layout(set = 0, binding = 0) uniform LightBuffer {
  mat4 viewMatrix;
  mat4 viewMatrixInverse;
  mat4 projectionMatrix;
  mat4 projectionMatrixInverse;
  int width;
  int height;
} lightBuffer;

layout(set = 1, binding = 0) uniform ObjectTransformBuffer { mat4 modelMatrix; } objectTransformBuffer;
layout(set = 1, binding = 1) uniform ObjectDataBuffer {
  uvec4 segmentation;
  float transparency;
  int shadeFlat;
  int body;
} objectDataBuffer;

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;  // unused, but all shader packs of a process must read the same vertex layout
layout(location = 4) in vec3 bitangent;

void main() {
  vec4 clipped = vec4(0.0, 0.0, -2.0, 1.0);
  gl_Position = objectDataBuffer.body < 0 ? clipped : lightBuffer.projectionMatrix * (lightBuffer.viewMatrix * (objectTransformBuffer.modelMatrix * vec4(position, 1.0)));
}
