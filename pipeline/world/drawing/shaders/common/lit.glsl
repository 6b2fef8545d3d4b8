// Bodies, lit per pixel: hemispheric ambient, a shadowed directional light, point lights, a two-tone room for reflections.
#include "interface.glsl"
#include "light.glsl"
#include "response.glsl"

layout(constant_id = 0) const int NUM_DIRECTIONAL_LIGHTS = 0;
layout(constant_id = 1) const int NUM_DIRECTIONAL_LIGHT_SHADOWS = 0;
layout(constant_id = 2) const int NUM_POINT_LIGHTS = 0;

layout(set = 3, binding = 1) uniform sampler2D samplerShadowMap;
layout(set = 3, binding = 2) uniform sampler2D samplerShadowMasks;

layout(location = 0) in vec3 inWorld;
layout(location = 1) in vec3 inNormal;
layout(location = 2) in vec2 inUV;
layout(location = 3) in vec3 inShadow;
layout(location = 4) flat in vec3 inColor;
layout(location = 5) flat in vec2 inSurface;
#ifndef FIRST_LOOK
layout(location = 6) in vec4 inLocal;

const float TABLE_TOP = 0.74;

// Share of the room's light that arrives: what the body itself leaves, less what the table takes from the sides of what is near it.
float openness(vec3 n) {
  float height = inWorld.z - TABLE_TOP;
  float near = height > -0.001 ? 0.012 / (0.012 + max(height, 0.0)) : 0.0;
  return inLocal.w * (1.0 - 0.40 * near * (1.0 - n.z));
}

// What use leaves on things: shades of a centimetre, grain of a millimetre and faint rubbed spots. The squares of the noise lie across
// the body, so no side repeats another.
float wear(out float rubbed) {
  vec2 at = inLocal.xy + inLocal.z * vec2(0.62, -0.47);
  float wide = clouds(at * 110.0 + 41.0), fine = square(ivec2(floor(at * 620.0)));
  rubbed = clamp(2.5 * wide - 1.5, 0.0, 1.0);
  return 0.925 + 0.10 * wide + 0.07 * fine;
}
#endif

#if defined SECOND_LOOK
float bilinear(vec2 uv, vec2 size, vec4 z) {
  vec4 lit = step(z, textureGather(samplerShadowMap, uv));
  vec2 f = fract(uv * size - 0.5);
  vec2 rows = mix(lit.wx, lit.zy, f.x);  // gather order: (0,1) (1,1) (1,0) (0,0)
  return mix(rows.x, rows.y, f.y);
}

// Share of the directional light that arrives: four bilinear depths around, so edges are 1.5 cm wide. Two of them are spared where the
// depths on one diagonal agree, which is almost everywhere.
float sunlight(vec3 at) {
  if (any(greaterThan(abs(at.xy - 0.5), vec2(0.49)))) return 1.0;
  vec2 uv = vec2(1.0 - at.x, at.y), size = vec2(textureSize(samplerShadowMap, 0));  // the map is mirrored in x
  vec4 z = vec4(min(at.z, 1.0));
  vec2 reach = 1.5 / size;
  float both = bilinear(uv - reach, size, z) + bilinear(uv + reach, size, z);
  if (both == 0.0 || both == 2.0) return 0.5 * both;
  return 0.25 * (both + bilinear(uv + vec2(reach.x, -reach.y), size, z) + bilinear(uv + vec2(-reach.x, reach.y), size, z));
}
#elif !defined FIRST_LOOK
// Share of the directional light that arrives: 16 depths around, weighted by a cubic B-spline, so that an edge is 1.5 cm wide and shows
// no texels.
float sunlight(vec3 at) {
  if (any(greaterThan(abs(at.xy - 0.5), vec2(0.49)))) return 1.0;
  vec2 size = vec2(textureSize(samplerShadowMap, 0));
  vec2 grid = vec2(1.0 - at.x, at.y) * size - 0.5;  // the map is mirrored in x
  vec2 f = fract(grid), g = 1.0 - f, texel = 1.0 / size, corner = (floor(grid) + 0.5) * texel;
  vec4 z = vec4(min(at.z, 1.0));
  // gather order: (0,1) (1,1) (1,0) (0,0)
  vec4 a = step(z, textureGather(samplerShadowMap, corner + texel * vec2(-0.5, -0.5)));
  vec4 d = step(z, textureGather(samplerShadowMap, corner + texel * vec2(1.5, 1.5)));
  vec4 b = step(z, textureGather(samplerShadowMap, corner + texel * vec2(1.5, -0.5)));
  vec4 c = step(z, textureGather(samplerShadowMap, corner + texel * vec2(-0.5, 1.5)));
  vec2 far = f * f * f, near = g * g * g;
  vec2 first = near * (1.0 / 6.0), last = far * (1.0 / 6.0);
  vec2 second = (4.0 - 6.0 * f * f + 3.0 * far) * (1.0 / 6.0), third = 1.0 - first - second - last;
  vec2 left = vec2(first.x, second.x), right = vec2(third.x, last.x);
  float row0 = dot(a.wz, left) + dot(b.wz, right);
  float row1 = dot(a.xy, left) + dot(b.xy, right);
  float row2 = dot(c.wz, left) + dot(d.wz, right);
  float row3 = dot(c.xy, left) + dot(d.xy, right);
  return row0 * first.y + row1 * second.y + row2 * third.y + row3 * last.y;
}
#else
// Share of the directional light that arrives: a 3x3-texel box filter with bilinear ends, from four gathers (16 depths). Two of them
// are spared where the depths on one diagonal agree, which is almost everywhere.
float sunlight(vec3 at) {
  if (any(greaterThan(abs(at.xy - 0.5), vec2(0.495)))) return 1.0;
  vec2 size = vec2(textureSize(samplerShadowMap, 0));
  vec2 grid = vec2(1.0 - at.x, at.y) * size - 0.5;  // the map is mirrored in x
  vec2 f = fract(grid);
  vec2 texel = 1.0 / size;
  vec2 corner = (floor(grid) + 0.5) * texel;
  vec4 z = vec4(min(at.z, 1.0));
  // gather order: (0,1) (1,1) (1,0) (0,0)
  vec4 a = step(z, textureGather(samplerShadowMap, corner + texel * vec2(-0.5, -0.5)));
  vec4 d = step(z, textureGather(samplerShadowMap, corner + texel * vec2(1.5, 1.5)));
  float both = dot(a + d, vec4(0.125));
  if (both == 0.0 || both == 1.0) return both;
  vec4 b = step(z, textureGather(samplerShadowMap, corner + texel * vec2(1.5, -0.5)));
  vec4 c = step(z, textureGather(samplerShadowMap, corner + texel * vec2(-0.5, 1.5)));
  vec2 left = vec2(1.0 - f.x, 1.0), right = vec2(1.0, f.x);
  float row0 = dot(a.wz, left) + dot(b.wz, right);
  float row1 = dot(a.xy, left) + dot(b.xy, right);
  float row2 = dot(c.wz, left) + dot(d.wz, right);
  float row3 = dot(c.xy, left) + dot(d.xy, right);
  return (row0 * (1.0 - f.y) + row1 + row2 + row3 * f.y) * (1.0 / 9.0);
}

#endif

vec3 shade() {
  vec3 base = inColor;
  vec2 surface = inSurface;
  if (base.r < 0.0) {
    base = texture(colorTexture, inUV).rgb;
    surface = vec2(materialBuffer.roughness, materialBuffer.metallic);
  }
  vec3 albedo = base * base;  // sRGB decoded with gamma 2
#ifndef FIRST_LOOK
  if (inColor.r >= 0.0) {  // textures bring their own
    float rubbed, tone = wear(rubbed);
    albedo *= 1.0 + (tone + 0.10 * rubbed - 1.0) * min(2.0 * surface.x, 1.0);  // little of it stays on glaze
    surface.x += 0.08 * rubbed;
  }
#endif
  float metallic = surface.y;
  float a = surface.x * surface.x;
#ifdef FIRST_LOOK
  float wide = a;
#else
  float wide = a + 0.07;  // window and lamps have a size
#endif
  float bulge = wide * wide - 1.0, height = 2.0 * wide * wide / (2.0 * wide + 1.0);
  vec3 diffuse = albedo * (1.0 - metallic);
  vec3 f0 = mix(vec3(0.04), albedo, metallic);

  vec3 v = normalize(cameraBuffer.viewMatrixInverse[3].xyz - inWorld);
  vec3 n = normalize(inNormal);
  float nv = dot(n, v);
  n = nv < 0.0 ? -n : n;
  nv = abs(nv);

#ifdef FIRST_LOOK
  vec3 scattered = sceneBuffer.ambientLight.rgb * (0.75 + 0.25 * n.z);
#else
  float open = openness(n), lamps = 0.4 + 0.6 * open;
  vec3 sunward = -sceneBuffer.directionalLights[0].direction.xyz;
  // The table gives light back to what is above it and faces down.
  vec3 table = vec3(objectDataBuffer.tableRed, objectDataBuffer.tableGreen, objectDataBuffer.tableBlue);
  float over = 0.25 / (0.25 + max(inWorld.z - TABLE_TOP, 0.0));
  vec3 scattered = (sceneBuffer.ambientLight.rgb * room_light(n, sunward) + table * (over * (0.5 - 0.5 * n.z) * 0.8)) * open;
#endif
  vec3 mirrored = vec3(0.0);

  for (int i = 0; i < NUM_DIRECTIONAL_LIGHTS; ++i) {
    vec3 l = -sceneBuffer.directionalLights[i].direction.xyz;
    float cosine = max(dot(n, l), 0.0);
#ifdef FIRST_LOOK
    float arrives = i < NUM_DIRECTIONAL_LIGHT_SHADOWS ? sunlight(inShadow) : 1.0;
#else
    float arrives = smoothstep(0.0, 0.3, cosine);  // facets of curved bodies shade themselves there
    if (i < NUM_DIRECTIONAL_LIGHT_SHADOWS && cosine > 0.0) arrives *= sunlight(inShadow);
#endif
    vec3 light = sceneBuffer.directionalLights[i].emission.rgb * (cosine * arrives);
    scattered += light;
    mirrored += light * highlight(cosine, nv, dot(l, v), bulge, height);
  }
  for (int i = 0; i < NUM_POINT_LIGHTS; ++i) {
    vec3 to = sceneBuffer.pointLights[i].position.xyz - inWorld;
    float inverse = inversesqrt(dot(to, to));
    vec3 l = to * inverse;
    float cosine = max(dot(n, l), 0.0);
    vec3 light = sceneBuffer.pointLights[i].emission.rgb * (cosine * inverse * inverse);
#ifndef FIRST_LOOK
    light *= lamps;
#endif
    scattered += light;
    mirrored += light * highlight(cosine, nv, dot(l, v), bulge, height);
  }

#ifdef FIRST_LOOK
  vec3 room = sceneBuffer.ambientLight.rgb * mirrored_room(2.0 * nv * n.z - v.z, a);
#else
  vec3 ray = 2.0 * nv * n - v;
  vec3 room = surroundings(ray, a, sunward, sceneBuffer.ambientLight.rgb, table) * open;
#endif
  return diffuse * scattered + f0 * mirrored + fresnel(f0, a, nv) * room;
}
