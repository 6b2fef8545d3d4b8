// Planes of the room: the light computed per vertex, with the sun where the mask of the plane lets it through.
#include "interface.glsl"
#include "light.glsl"
#include "response.glsl"

layout(constant_id = 0) const int NUM_DIRECTIONAL_LIGHT_SHADOWS = 0;

layout(set = 3, binding = 1) uniform sampler2D samplerShadowMap;
layout(set = 3, binding = 2) uniform sampler2D samplerShadowMasks;

layout(location = 0) in vec3 inScattered;
layout(location = 1) in vec3 inMirrored;
layout(location = 2) flat in vec3 inSun;
layout(location = 3) in float inSunMirrored;
layout(location = 4) in vec2 inUV;
layout(location = 5) in vec2 inShadow;
layout(location = 6) flat in vec3 inColor;

// Naming level 0 of textures that have no other spares the choice of a level, half the cost of sampling.
vec3 shade() {
  vec3 base = inColor;
  if (base.r < 0.0) base = textureLod(colorTexture, inUV, 0.0).rgb;
  vec3 albedo = base * base;  // sRGB decoded with gamma 2
  vec3 sun = inSun;
#ifdef FIRST_LOOK
  if (NUM_DIRECTIONAL_LIGHT_SHADOWS > 0) sun *= textureLod(samplerShadowMasks, vec2(1.0 - inShadow.x, inShadow.y), 0.0)[objectDataBuffer.plane];
  return albedo * (inScattered + sun) + inMirrored + sun * inSunMirrored;
#else
  float open = 1.0;
  if (NUM_DIRECTIONAL_LIGHT_SHADOWS > 0 && objectDataBuffer.plane < 2) {
    vec4 masks = textureLod(samplerShadowMasks, vec2(1.0 - inShadow.x, inShadow.y), 0.0);
    bool table = objectDataBuffer.plane == 0;
    sun *= table ? masks.r : masks.g;
    open = table ? masks.b : 1.0;  // what stands on the table takes light from it
  }
  return (albedo * inScattered + inMirrored + (albedo + inSunMirrored) * sun) * open;
#endif
}
