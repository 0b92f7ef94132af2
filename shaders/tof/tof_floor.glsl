#version 330 core
// tof_floor: the noise of the depth that does not depend on the light; new in every frame.
//@ sparse
#include "lib/alike.glsl"
#include "lib/floor.glsl"
#include "lib/depth.glsl"

uniform sampler2D u_depth;
uniform sampler2D u_normal;
uniform sampler2D u_rays;
uniform uint u_seed;

out float depth;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    vec3 normal = texelFetch(u_normal, pixel, 0).xyz;
    float sigma = sqrt(floor_variance(depth, normal, texelFetch(u_rays, pixel, 0).rg));
    depth = moved_by_mm(depth, sigma * alike_noise(pixel, u_seed));
}
