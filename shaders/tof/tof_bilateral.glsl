#version 330 core
// tof_bilateral: libfreenect2's joint bilateral filter: each phasor becomes a mean over 3x3, where
// neighbours with another phase count less. Pixels whose phases differ from those around in any
// frequency are marked; tof_edge removes them.
//@ sparse
#include "lib/kernel.glsl"
#include "lib/loops.glsl"

uniform float min_amplitude = 3.0; //@ [0, 1000] 1 a neighbour needs this amplitude (libfreenect2: joint_bilateral_ab_threshold)
uniform float sharpness = 5.0;     //@ [0, 100]  1 how fast the weight falls with the phase (joint_bilateral_exp)
uniform float max_edge = 2.5;      //@ [0, 8]    1 sum of the neighbours' distances, each 0 to 1, that marks a pixel (joint_bilateral_max_edge)

uniform sampler2D u_phasor_a;
uniform sampler2D u_phasor_b;
uniform vec2 u_frame_size_px;

const float LOG2_E = 1.442695; // as the decoder writes it: weight = exp(-1.442695 sharpness distance)

out vec4 phasor_a;
out vec4 phasor_b; // flags: + 1 marked as an edge

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 own_a = texelFetch(u_phasor_a, pixel, 0), own_b = texelFetch(u_phasor_b, pixel, 0);
    vec3 real = vec3(own_a.xz, own_b.x), imaginary = vec3(own_a.yw, own_b.y);
    vec3 norm = real * real + imaginary * imaginary;
    vec3 unit = inversesqrt(max(norm, 1e-20));
    // A pixel that is itself too dark takes the mean of all.
    vec3 bright = step(min_amplitude * min_amplitude, norm);
    vec3 least = bright * min_amplitude * min_amplitude;
    vec3 falloff = -LOG2_E * sharpness * bright;
    vec3 sum_real = KERNEL_MIDDLE * real, sum_imaginary = KERNEL_MIDDLE * imaginary;
    vec3 total = vec3(KERNEL_MIDDLE), apart = vec3(0.0);
    bool seen = own_b.z > 0.0;
    int k = seen ? 0 : 7;
    do {
        int place = k + int(k > 3); // the 8 neighbours, without the middle
        ivec2 offset = ivec2(place % 3, place / 3) - 1;
        vec4 a = texelFetch(u_phasor_a, pixel + offset, 0);
        vec2 b = texelFetch(u_phasor_b, pixel + offset, 0).xy;
        vec3 other_real = vec3(a.xz, b.x), other_imaginary = vec3(a.yw, b.y);
        vec3 other_norm = other_real * other_real + other_imaginary * other_imaginary;
        vec3 alike = (real * other_real + imaginary * other_imaginary)
            * unit * inversesqrt(max(other_norm, 1e-20));
        vec3 away = 0.5 - 0.5 * alike;
        vec3 counts = step(least, other_norm);
        vec3 weight = counts * kernel(offset) * exp(falloff * away);
        apart += counts * away;
        sum_real += weight * other_real;
        sum_imaginary += weight * other_imaginary;
        total += weight;
    } while (++k < 8);
    bool edge = max(apart.x, max(apart.y, apart.z)) >= max_edge;
    vec3 mean_real = sum_real / total, mean_imaginary = sum_imaginary / total;
    ivec2 last = ivec2(u_frame_size_px) - 1;
    // The decoder leaves the border alone.
    bool kept = !seen || any(equal(pixel, ivec2(0))) || any(equal(pixel, last));
    edge = edge && !kept;
    mean_real = kept ? real : mean_real;
    mean_imaginary = kept ? imaginary : mean_imaginary;
    phasor_a = vec4(mean_real.x, mean_imaginary.x, mean_real.y, mean_imaginary.y);
    phasor_b = vec4(mean_real.z, mean_imaginary.z, own_b.z, own_b.w + (edge ? 1.0 : 0.0));
}
