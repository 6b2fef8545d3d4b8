// Bodies: world-space position, normal and shadow coordinate per vertex, and the material of untextured parts.
#include "interface.glsl"
#include "attributes.glsl"
#include "sun.glsl"

layout(location = 0) out vec3 outWorld;
layout(location = 1) out vec3 outNormal;
layout(location = 2) out vec2 outUV;
layout(location = 3) out vec3 outShadow;
layout(location = 4) flat out vec3 outColor;
layout(location = 5) flat out vec2 outSurface;
#ifndef FIRST_LOOK
layout(location = 6) out vec4 outLocal;  // position in the body, and the share of the room's light
#endif

void main() {
  vec4 world = objectTransformBuffer.modelMatrix * vec4(position, 1.0);
  vec3 n = mat3(objectTransformBuffer.modelMatrix) * normal;
#ifndef FIRST_LOOK
  // Normals are as long as the share of the room's light that reaches them: occlusion.py.
  outLocal = vec4(position, length(normal));
  n /= max(outLocal.w, 0.01);
#endif
  outWorld = world.xyz;
  outNormal = n;
  outShadow = sun_coordinates(world.xyz + SHADOW_OFFSET * n);
  outColor = unpacked_color();
  outSurface = unpacked_surface();
  outUV = outColor.r < 0.0 ? uv : vec2(0.0);
  gl_Position = cameraBuffer.projectionMatrix * (cameraBuffer.viewMatrix * world);
}
