// Linear up to the knee, then a smooth shoulder that reaches white only in the limit; encoded with gamma 2.
vec3 display(vec3 radiance) {
  const float knee = 0.65;
#ifndef FIRST_LOOK
  // The lens: less light towards the corners. The camera: nine tenths of the colour there is, and an S-curve: 0.3 of 3 s^2 - 2 s^3.
  vec2 off = gl_FragCoord.xy / cameraBuffer.width - vec2(0.5, 0.5 * cameraBuffer.height / cameraBuffer.width);
  radiance = (radiance * 0.9 + dot(radiance, vec3(0.025, 0.062, 0.013))) * (1.0 - 0.55 * dot(off, off));
#endif
  vec3 over = max(radiance - knee, 0.0);
#ifdef FIRST_LOOK
  return sqrt(min(radiance, knee) + over * (1.0 - knee) / (over + (1.0 - knee)));
#else
  vec3 light = min(radiance, knee) + over * (1.0 - knee) / (over + (1.0 - knee));
  return sqrt(light) * (0.7 - 0.6 * light) + 0.9 * light;
#endif
}
