#version 330 core
// tof_smooth: averages phasors over 7x7; neighbours with another phase count less.
// The decoder of the Azure Kinect is not published. Its noise is correlated over four pixels, as a mean
// over 7x7 makes it, and its rims bend: a brighter neighbour of almost the same phase draws a pixel along.
// Pixels whose neighbours have other phases are marked; tof_edge removes them.
//@ sparse
#include "lib/loops.glsl"

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
    vec4 own_a = textureLod(u_phasor_a, gl_FragCoord.xy * texel, 0.0);
    vec4 own_b = textureLod(u_phasor_b, gl_FragCoord.xy * texel, 0.0);
    vec3 real = vec3(own_a.xz, own_b.x), imaginary = vec3(own_a.yw, own_b.y);
    vec3 norm = real * real + imaginary * imaginary;
    vec3 unit = inversesqrt(max(norm, 1e-20));
    // A pixel that is too dark itself takes the plain mean.
    vec3 bright = step(min_amplitude * min_amplitude, norm);
    vec3 least = bright * min_amplitude * min_amplitude;
    float falloff = -0.5 / (width_px * width_px);
    vec3 sum_real = vec3(0.0), sum_imaginary = vec3(0.0), total = vec3(0.0);
    vec3 apart = vec3(0.0), near = vec3(1e-6);
    vec2 offset = vec2(-REACH);
    do {
        vec2 at = (gl_FragCoord.xy + offset) * texel; // clamped at the frame
        vec4 a = textureLod(u_phasor_a, at, 0.0);
        vec2 b = textureLod(u_phasor_b, at, 0.0).xy;
        vec3 other_real = vec3(a.xz, b.x), other_imaginary = vec3(a.yw, b.y);
        vec3 other = other_real * other_real + other_imaginary * other_imaginary;
        vec3 alike = (real * other_real + imaginary * other_imaginary)
            * unit * inversesqrt(max(other, 1e-20));
        vec3 away = 0.5 - 0.5 * alike;
        vec3 counts = step(least, other);
        vec3 weights = counts * exp(falloff * dot(offset, offset) - sharpness * bright * away);
        sum_real += weights * other_real;
        sum_imaginary += weights * other_imaginary;
        total += weights;
        apart += counts * away;
        near += counts;
        // No division of whole numbers: a software rasteriser makes it pixel by pixel.
        offset = offset.x < float(REACH) ? offset + vec2(1.0, 0.0) : vec2(-REACH, offset.y + 1.0);
    } while (offset.y <= float(REACH));
    bool kept = own_b.z <= 0.0 || any(lessThanEqual(total, vec3(0.0)));
    vec3 share = apart / near;
    bool edge = !kept && max(share.x, max(share.y, share.z)) >= max_apart;
    vec3 mean_real = kept ? real : sum_real / total;
    vec3 mean_imaginary = kept ? imaginary : sum_imaginary / total;
    phasor_a = vec4(mean_real.x, mean_imaginary.x, mean_real.y, mean_imaginary.y);
    phasor_b = vec4(mean_real.z, mean_imaginary.z, own_b.z, own_b.w + (edge ? 1.0 : 0.0));
}
