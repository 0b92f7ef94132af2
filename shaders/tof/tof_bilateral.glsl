#version 330 core
// tof_bilateral: averages phasors over 3x3 with libfreenect2's joint bilateral filter.
// Neighbours with another phase count less. Pixels whose phase differs from their neighbours' at any
// frequency are marked; tof_edge removes them.
//@ sparse
#include "lib/kernel.glsl"
#include "lib/phasor_mean.glsl"

uniform float min_amplitude = 3.0; //@ [0, 1000] 1 minimum amplitude of a neighbour (libfreenect2: joint_bilateral_ab_threshold)
uniform float sharpness = 5.0;     //@ [0, 100]  1 decay of the weight with the phase difference (joint_bilateral_exp)
uniform float max_edge = 2.5;      //@ [0, 8]    1 sum of the neighbours' phase distances, each 0 to 1, that marks a pixel (joint_bilateral_max_edge)

uniform sampler2D u_phasor_a;
uniform sampler2D u_phasor_b;
uniform vec2 u_frame_size_px;

const float LOG2_E = 1.442695; // as the decoder rounds it: weight = exp(-1.442695 sharpness distance)

out vec4 phasor_a;
out vec4 phasor_b; // w: flags, + 1 if marked as an edge

void add(inout PhasorMean mean, vec2 offset, float weight) {
    vec2 at = (gl_FragCoord.xy + offset) / vec2(textureSize(u_phasor_a, 0));
    add_neighbour(mean, textureLod(u_phasor_a, at, 0.0), textureLod(u_phasor_b, at, 0.0), weight, 0.0,
        LOG2_E * sharpness);
}

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_phasor_a, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy), last = ivec2(u_frame_size_px) - 1;
    phasor_a = textureLod(u_phasor_a, here, 0.0);
    phasor_b = textureLod(u_phasor_b, here, 0.0);
    PhasorMean mean = phasor_mean(phasor_a, phasor_b, min_amplitude);
    mean.real = KERNEL_MIDDLE * mean.own_real;
    mean.imaginary = KERNEL_MIDDLE * mean.own_imaginary;
    mean.weights = vec3(KERNEL_MIDDLE);
    add(mean, vec2(-1, -1), KERNEL_CORNER);
    add(mean, vec2(0, -1), KERNEL_SIDE);
    add(mean, vec2(1, -1), KERNEL_CORNER);
    add(mean, vec2(-1, 0), KERNEL_SIDE);
    add(mean, vec2(1, 0), KERNEL_SIDE);
    add(mean, vec2(-1, 1), KERNEL_CORNER);
    add(mean, vec2(0, 1), KERNEL_SIDE);
    add(mean, vec2(1, 1), KERNEL_CORNER);
    // The decoder does not filter the border.
    bool kept = phasor_b.z <= 0.0 || any(equal(pixel, ivec2(0))) || any(equal(pixel, last));
    bool edge = !kept && max(mean.apart.x, max(mean.apart.y, mean.apart.z)) >= max_edge;
    set_phasors(mean, kept, edge, phasor_a, phasor_b);
}
