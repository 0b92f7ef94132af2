#version 330 core
// pattern_exposure: exposes the infrared image of a structured-light camera, and its pattern.
// The pattern, which the image is matched with, is blurred like the image.
#include "lib/imager_exposure.glsl"

uniform float reference_counts = 120.0;  //@ [1, 65535; 1, 250] counts of a dot's centre in the pattern that images are matched with; chosen: matching sees differences of neighbours

uniform sampler2D u_light_left;
uniform sampler2D u_light_right;

out float infrared;
out float reference;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float noise = normal_pair(random_bits(pixel, u_seed, 0u).xy).x;
    float gain = normal_pair(random_bits(pixel, u_device_seed, 1u).xy).x;
    infrared = counts(blurred(u_light_left, pixel), noise, gain);
    float level = reference_counts * blurred(u_light_right, pixel);
    reference = clamp(floor(level + 0.5), 0.0, exp2(float(bits)) - 1.0);
}
