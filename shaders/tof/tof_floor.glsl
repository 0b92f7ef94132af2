#version 330 core
// tof_floor: adds the depth noise that does not depend on the light, new in every frame.
//@ sparse
#include "lib/correlated_noise.glsl"
#include "lib/floor.glsl"
#include "lib/depth.glsl"

uniform sampler2D u_depth;
uniform sampler2D u_normal;
uniform sampler2D u_rays;
uniform uint u_seed;

out float depth;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_depth, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = textureLod(u_depth, here, 0.0).r;
    vec3 normal = textureLod(u_normal, here, 0.0).xyz;
    float sigma = sqrt(floor_variance(depth, normal, textureLod(u_rays, here, 0.0).rg));
    depth = moved_by_mm(depth, sigma * correlated_noise(pixel, u_seed));
}
