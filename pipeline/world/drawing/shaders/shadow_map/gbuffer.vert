#version 450
#extension GL_GOOGLE_include_directive : enable
// Depth as seen by the sun. The map is mirrored in x, which turns the winding around: the faces that the engine culls as back faces
// are those towards the light, so the map holds the far side of every body and a lit surface does not shade itself.
#include "../common/interface.glsl"
#include "../common/attributes.glsl"
#include "../common/sun.glsl"

void main() {
  vec3 at = sun_coordinates((objectTransformBuffer.modelMatrix * vec4(position, 1.0)).xyz);
  gl_Position = vec4(1.0 - 2.0 * at.x, 2.0 * at.y - 1.0, at.z, 1.0);
}
