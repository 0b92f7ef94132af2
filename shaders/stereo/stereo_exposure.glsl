#version 330 core
// stereo_exposure: exposes the two infrared images: blur, noise and counts.
#include "lib/imager_exposure.glsl"

uniform sampler2D u_light_left;
uniform sampler2D u_light_right;

out float infrared;
out float infrared_right;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 noise = normal_pair(random_bits(pixel, u_seed, 0u).xy);
    vec2 gain = normal_pair(random_bits(pixel, u_device_seed, 1u).xy);
    infrared = counts(blurred(u_light_left, pixel), noise.x, gain.x);
    infrared_right = counts(blurred(u_light_right, pixel), noise.y, gain.y);
}
