// Planes of the room: all light is computed per vertex, so their meshes are fine grids. Planes are no metals.
#include "interface.glsl"
#include "attributes.glsl"
#include "sun.glsl"
#include "light.glsl"

// What reaches the eye besides the sun: scattered light, to be multiplied by the albedo, and mirrored light.
layout(location = 0) out vec3 outScattered;
layout(location = 1) out vec3 outMirrored;
// The same of the sun where nothing is in its way; mirrored as a share of its light.
layout(location = 2) flat out vec3 outSun;
layout(location = 3) out float outSunMirrored;
layout(location = 4) out vec2 outUV;
layout(location = 5) out vec2 outShadow;
layout(location = 6) flat out vec3 outColor;

const float F0 = 0.04;

void main() {
  vec4 world = objectTransformBuffer.modelMatrix * vec4(position, 1.0);
  vec3 n = mat3(objectTransformBuffer.modelMatrix) * normal;
  gl_Position = cameraBuffer.projectionMatrix * (cameraBuffer.viewMatrix * world);
  outColor = unpacked_color();
  outUV = outColor.r < 0.0 ? uv : vec2(0.0);
  outShadow = sun_coordinates(world.xyz + SHADOW_OFFSET * n).xy;

  float a = objectDataBuffer.roughness * objectDataBuffer.roughness;
  float bulge = a * a - 1.0, height = 2.0 * a * a / (2.0 * a + 1.0);
  vec3 v = normalize(cameraBuffer.viewMatrixInverse[3].xyz - world.xyz);
  float nv = max(dot(n, v), 0.0);

#ifdef FIRST_LOOK
  outScattered = sceneBuffer.ambientLight.rgb * (0.75 + 0.25 * n.z);
#else
  // Walls get what floor and ceiling give back.
  // More arrives near the window, and little from behind the table.
  float near = 1.0 - 0.16 * dot(world.xyz - SHADOW_CENTRE, sceneBuffer.directionalLights[0].direction.xyz * vec3(1.0, 1.0, 0.0));
  float behind = mix(clamp(0.3 + 0.7 * (world.z - 0.2), 0.5, 1.0), 1.0, abs(n.z));
  outScattered = sceneBuffer.ambientLight.rgb * ((1.0 + 0.7 * (1.0 - abs(n.z))) * clamp(near, 0.6, 1.4) * behind);
#endif
  outMirrored = sceneBuffer.ambientLight.rgb * (mirrored_room(2.0 * nv * n.z - v.z, a) * fresnel(vec3(F0), a, nv).r);
  for (int i = 0; i < objectDataBuffer.points; ++i) {
    vec3 to = sceneBuffer.pointLights[i].position.xyz - world.xyz;
    float inverse = inversesqrt(dot(to, to));
    vec3 l = to * inverse;
    float cosine = max(dot(n, l), 0.0);
    vec3 light = sceneBuffer.pointLights[i].emission.rgb * (cosine * inverse * inverse);
    outScattered += light;
    outMirrored += light * (F0 * highlight(cosine, nv, dot(l, v), bulge, height));
  }
  vec3 l = -sceneBuffer.directionalLights[0].direction.xyz;
  float cosine = max(dot(n, l), 0.0);
  outSun = sceneBuffer.directionalLights[0].emission.rgb * cosine;
  outSunMirrored = F0 * highlight(cosine, nv, dot(l, v), bulge, height);
}
