// Light that bodies and planes share. Values are radiance times pi, so a white surface facing a light of 1 shows 1 before tone mapping.

// Microfacet highlight over the cosine, after Karis' mobile form of GGX, a^2 / (((n.h)^2 (a^2 - 1) + 1)^2 (l.h)^2 (4 a + 2)), without
// the half vector: |l + v|^2 = 2 + 2 l.v, n.h = (n.l + n.v) / |l + v| and (l.h)^2 = |l + v|^2 / 4. `bulge` is a^2 - 1, `height` 2 a^2 / (2 a + 1).
float highlight(float nl, float nv, float lv, float bulge, float height) {
  float square = max(2.0 + 2.0 * lv, 0.04), sum = nl + nv;
  float q = sum * sum * bulge + square;
  return height * square / (q * q);
}

// Share of the room's light, a bright ceiling and a dim floor, that smooth and metallic surfaces mirror; `up` is the z of the mirrored ray.
float mirrored_room(float up, float a) {
  return 0.55 + 0.65 * clamp(up / (0.5 + a) * 0.5 + 0.5, 0.0, 1.0);
}

// The room that surfaces mirror, as far as that roughness tells its parts apart: the table below, which scatters the light `table`, a
// dim horizon, a bright ceiling, and the window where the sun comes from.
vec3 surroundings(vec3 ray, float a, vec3 sunward, vec3 ambient, vec3 table) {
  float above = clamp(ray.z / (0.16 + 2.0 * a) + 0.5, 0.0, 1.0);
  float pane = clamp((dot(ray, vec3(1.4 * sunward.xy, 0.6 * sunward.z)) - 0.80) / (0.06 + a) + 0.5, 0.0, 1.0);
  float sky = 0.30 + 0.80 * clamp(ray.z, 0.0, 1.0) + pane * (2.2 - 1.8 * a);
  return mix(table * (1.0 + 0.5 * min(ray.z, 0.0)), ambient * sky, above);
}

// Ambient light by the normal: most from the ceiling, some more from where the sun comes from, least from below.
float room_light(vec3 n, vec3 sunward) {
  return 0.60 + 0.26 * n.z + 0.20 * dot(n, sunward);
}

// A number in 0-1 for each square of a grid.
float square(ivec2 at) {
  uint h = uint(at.x) * 73856093u ^ uint(at.y) * 19349663u;
  h = (h ^ (h >> 13)) * 1540483477u;
  return float((h >> 16) & 255u) * (1.0 / 255.0);
}

// Smooth noise in 0-1 of cells of size 1.
float clouds(vec2 at) {
  vec2 low = floor(at), f = at - low;
  ivec2 i = ivec2(low);
  f = f * f * (3.0 - 2.0 * f);
  return mix(mix(square(i), square(i + ivec2(1, 0)), f.x), mix(square(i + ivec2(0, 1)), square(i + ivec2(1, 1)), f.x), f.y);
}

// Reflectance of a surface of normal reflectance f0 seen at the cosine nv.
vec3 fresnel(vec3 f0, float a, float nv) {
  float grazing = (1.0 - nv) * (1.0 - nv);
  return f0 + (1.0 - a) * (1.0 - a) * 0.2 * grazing * grazing * (1.0 - f0);
}
