// What a vertex holds. Tangents are unused, but all shader packs of a process must read the same vertex layout.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec3 tangent;
layout(location = 4) in vec3 bitangent;

// Untextured parts carry their material in their uvs: batching.py writes them.
const float PLAIN = -1048576.0;

// sRGB of an untextured part, negative where a texture gives it.
vec3 unpacked_color() {
  int rgb = int(uv.x);
  return uv.y <= PLAIN ? vec3(rgb >> 16, (rgb >> 8) & 255, rgb & 255) / 255.0 : vec3(-1.0);
}

// Roughness and metallic of an untextured part.
vec2 unpacked_surface() {
  int surface = int(PLAIN - uv.y);
  return vec2(surface >> 8, surface & 255) / 255.0;
}
