#version 330 core
// tof_bilateral: averages phasors over 3x3 with libfreenect2's joint bilateral filter.
// Neighbours with another phase count less. Pixels whose phase differs from their neighbours' at any
// frequency are marked; tof_edge removes them.
//@ sparse
#include "lib/kernel.glsl"

uniform float min_amplitude = 3.0; //@ [0, 1000] 1 minimum amplitude of a neighbour (libfreenect2: joint_bilateral_ab_threshold)
uniform float sharpness = 5.0;     //@ [0, 100]  1 decay of the weight with the phase difference (joint_bilateral_exp)
uniform float max_edge = 2.5;      //@ [0, 8]    1 sum of the neighbours' phase distances, each 0 to 1, that marks a pixel (joint_bilateral_max_edge)

uniform sampler2D u_phasor_a;
uniform sampler2D u_phasor_b;
uniform vec2 u_frame_size_px;

const float LOG2_E = 1.442695; // as the decoder rounds it: weight = exp(-1.442695 sharpness distance)

out vec4 phasor_a;
out vec4 phasor_b; // w: flags, + 1 if marked as an edge

// Sums over the neighbours of a pixel, for the three frequencies.
struct Sums {
    vec3 real, imaginary, weights;
    vec3 apart; // sum of phase distances: 0 for the same phase, 1 for the opposite one
};

// Adds a neighbour. unit: 1 / amplitude of the pixel's own phasor.
void add(inout Sums sums, vec2 offset, float weight, vec3 real, vec3 imaginary, vec3 unit,
         vec3 least, vec3 falloff) {
    vec2 at = (gl_FragCoord.xy + offset) / vec2(textureSize(u_phasor_a, 0));
    vec4 a = textureLod(u_phasor_a, at, 0.0);
    vec2 b = textureLod(u_phasor_b, at, 0.0).xy;
    vec3 other_real = vec3(a.xz, b.x), other_imaginary = vec3(a.yw, b.y);
    vec3 norm = other_real * other_real + other_imaginary * other_imaginary;
    vec3 alike = (real * other_real + imaginary * other_imaginary)
        * unit * inversesqrt(max(norm, 1e-20));
    vec3 away = 0.5 - 0.5 * alike;
    vec3 counts = step(least, norm);
    vec3 weights = counts * weight * exp(falloff * away);
    sums.apart += counts * away;
    sums.real += weights * other_real;
    sums.imaginary += weights * other_imaginary;
    sums.weights += weights;
}

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_phasor_a, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 own_a = textureLod(u_phasor_a, here, 0.0), own_b = textureLod(u_phasor_b, here, 0.0);
    vec3 real = vec3(own_a.xz, own_b.x), imaginary = vec3(own_a.yw, own_b.y);
    vec3 norm = real * real + imaginary * imaginary;
    vec3 unit = inversesqrt(max(norm, 1e-20));
    // A pixel that is too dark itself takes the plain mean.
    vec3 bright = step(min_amplitude * min_amplitude, norm);
    vec3 least = bright * min_amplitude * min_amplitude;
    vec3 falloff = -LOG2_E * sharpness * bright;
    Sums sums = Sums(KERNEL_MIDDLE * real, KERNEL_MIDDLE * imaginary, vec3(KERNEL_MIDDLE), vec3(0.0));
    add(sums, vec2(-1, -1), KERNEL_CORNER, real, imaginary, unit, least, falloff);
    add(sums, vec2(0, -1), KERNEL_SIDE, real, imaginary, unit, least, falloff);
    add(sums, vec2(1, -1), KERNEL_CORNER, real, imaginary, unit, least, falloff);
    add(sums, vec2(-1, 0), KERNEL_SIDE, real, imaginary, unit, least, falloff);
    add(sums, vec2(1, 0), KERNEL_SIDE, real, imaginary, unit, least, falloff);
    add(sums, vec2(-1, 1), KERNEL_CORNER, real, imaginary, unit, least, falloff);
    add(sums, vec2(0, 1), KERNEL_SIDE, real, imaginary, unit, least, falloff);
    add(sums, vec2(1, 1), KERNEL_CORNER, real, imaginary, unit, least, falloff);
    ivec2 last = ivec2(u_frame_size_px) - 1;
    // The decoder does not filter the border.
    bool kept = own_b.z <= 0.0 || any(equal(pixel, ivec2(0))) || any(equal(pixel, last));
    bool edge = !kept && max(sums.apart.x, max(sums.apart.y, sums.apart.z)) >= max_edge;
    vec3 mean_real = kept ? real : sums.real / sums.weights;
    vec3 mean_imaginary = kept ? imaginary : sums.imaginary / sums.weights;
    phasor_a = vec4(mean_real.x, mean_imaginary.x, mean_real.y, mean_imaginary.y);
    phasor_b = vec4(mean_real.z, mean_imaginary.z, own_b.z, own_b.w + (edge ? 1.0 : 0.0));
}
