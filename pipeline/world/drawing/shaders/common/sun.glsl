// The shadow map's coordinates: x and y in 0-1 across the square around the table, z in 0-1 along the light of the sun.
// The numbers are those of shadows.py.
const vec3 SHADOW_CENTRE = vec3(0.0, 0.0, 0.74);
const float SHADOW_HALF_SIZE = 0.85;
const float SHADOW_DEPTH = 1.2;

// Moving the looked-up point off the surface by about a shadow texel keeps a surface from shading itself.
const float SHADOW_OFFSET = 0.004;

vec3 sun_coordinates(vec3 world) {
  vec3 forward = normalize(sceneBuffer.directionalLights[0].direction.xyz);
  vec3 helper = abs(forward.x) < 0.9 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0);
  vec3 right = normalize(cross(helper, forward));
  vec3 at = world - SHADOW_CENTRE;
  vec3 scaled = vec3(dot(right, at), dot(cross(forward, right), at), dot(forward, at)) / vec3(vec2(SHADOW_HALF_SIZE), SHADOW_DEPTH);
  return scaled * 0.5 + 0.5;
}
