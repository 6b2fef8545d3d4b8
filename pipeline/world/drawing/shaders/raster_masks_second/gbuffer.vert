#version 450
#extension GL_GOOGLE_include_directive : enable
#define SECOND_LOOK
#include "../common/vertex.glsl"
