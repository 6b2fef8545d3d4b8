// World-space position, normal and shadow coordinate per vertex: everything the one lit pass interpolates.
#include "interface.glsl"

layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;  // unused, but all shader packs of a process must read the same vertex layout
layout(location = 4) in vec3 bitangent;

layout(location = 0) out vec3 outWorld;
layout(location = 1) out vec3 outNormal;
layout(location = 2) out vec2 outUV;
layout(location = 3) out vec3 outShadow;

// Moving the looked-up point off the surface by about a shadow texel keeps a surface from shading itself.
const float SHADOW_OFFSET = 0.004;

void main() {
  vec4 world = objectTransformBuffer.modelMatrix * vec4(position, 1.0);
  vec3 n = mat3(objectTransformBuffer.modelMatrix) * normal;
  outWorld = world.xyz;
  outNormal = n;
  outUV = uv;
  vec4 lit = shadowBuffer.directionalLightBuffers[0].viewMatrix * vec4(world.xyz + SHADOW_OFFSET * n, 1.0);
  lit = shadowBuffer.directionalLightBuffers[0].projectionMatrix * lit;
  outShadow = vec3(lit.xy * 0.5 + 0.5, lit.z);
  gl_Position = cameraBuffer.projectionMatrix * (cameraBuffer.viewMatrix * world);
}
