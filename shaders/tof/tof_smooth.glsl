#version 330 core
// tof_smooth: averages phasors over 7x7; neighbours with another phase count less.
// The decoder of the Azure Kinect is not published. Its noise is correlated over four pixels, as a mean
// over 7x7 makes it, and its rims bend: a brighter neighbour of almost the same phase draws a pixel along.
// Pixels whose neighbours have other phases are marked; tof_edge removes them.
//@ sparse
#include "lib/loops.glsl"
#include "lib/phasor_mean.glsl"

uniform float width_px = 2.0;      //@ [0.1, 10] px standard deviation of the weights over 7x7
uniform float sharpness = 5.0;     //@ [0, 100]  1  decay of the weight with the phase distance, 0 for the same phase and 1 for the opposite one
uniform float min_amplitude = 3.0; //@ [0, 1000] 1  minimum amplitude of a neighbour
uniform float max_apart = 0.3;     //@ [0, 1]    1  mean phase distance of the 48 neighbours that marks a pixel, at any frequency

uniform sampler2D u_phasor_a;
uniform sampler2D u_phasor_b;

const int REACH = 3;

out vec4 phasor_a;
out vec4 phasor_b; // w: flags, + 1 if marked as an edge

void main() {
    vec2 texel = 1.0 / vec2(textureSize(u_phasor_a, 0));
    phasor_a = textureLod(u_phasor_a, gl_FragCoord.xy * texel, 0.0);
    phasor_b = textureLod(u_phasor_b, gl_FragCoord.xy * texel, 0.0);
    PhasorMean mean = phasor_mean(phasor_a, phasor_b, min_amplitude);
    float falloff = -0.5 / (width_px * width_px);
    vec2 offset = vec2(-REACH);
    do {
        vec2 at = (gl_FragCoord.xy + offset) * texel; // clamped at the frame
        add_neighbour(mean, textureLod(u_phasor_a, at, 0.0), textureLod(u_phasor_b, at, 0.0), 1.0,
            falloff * dot(offset, offset), sharpness);
        // No division of whole numbers: a software rasteriser makes it pixel by pixel.
        offset = offset.x < float(REACH) ? offset + vec2(1.0, 0.0) : vec2(-REACH, offset.y + 1.0);
    } while (offset.y <= float(REACH));
    bool kept = phasor_b.z <= 0.0 || any(lessThanEqual(mean.weights, vec3(0.0)));
    vec3 share = mean.apart / mean.near;
    bool edge = !kept && max(share.x, max(share.y, share.z)) >= max_apart;
    set_phasors(mean, kept, edge, phasor_a, phasor_b);
}
