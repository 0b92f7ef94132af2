#version 330 core
// tof_light: computes the light of each pixel as one phasor (amplitude and phase) per frequency.
// Amplitude: Lambert's law and the inverse square of the distance to the emitter. Phase: half the
// path emitter, surface, camera. A pixel that sees one smooth surface is evaluated at its centre. A
// pixel at an edge is the sum of its samples' phasors: mixed pixels then follow from physics;
// depths are not averaged.
//@ sparse
#include "lib/surface_light.glsl"
#include "lib/loops.glsl"

uniform float smooth_mm = 0.05;    //@ [0, 100]   mm depth error up to which the centre of a pixel replaces its samples, beyond 1 m times the square of the depth, as noise grows; 0: never
uniform float indirect_spread_mm = 0.0; //@ [0, 5000] mm standard deviation of the lengths of the ways by which light reaches a shadow, halved; it takes contrast from the fast frequencies

uniform sampler2D u_clean;
uniform sampler2D u_normal; // w: albedo
uniform sampler2D u_rays;
uniform sampler2D u_lit;
uniform sampler2D u_uneven;
uniform sampler2D u_fine_seen; // depth, albedo
uniform int u_supersample;
uniform float u_focal_px;

out vec4 light_a; // real and imaginary part at the first and the second frequency
out vec4 light_b; // at the third frequency; amplitude; unused
#ifdef EXPECTED
out float expected;
#endif

// The contrast that is left at each frequency where part of the light came on many ways.
vec3 contrast(float lit) {
    float around = indirect * (1.0 - lit), share = around / max(lit + around, 1e-6);
    vec3 turn = TWO_PI * u_modulation_mhz / HALF_WAVE_M_MHZ * 0.001 * indirect_spread_mm;
    return 1.0 - share * (1.0 - exp(-0.5 * turn * turn));
}

float clean_at(vec2 place) {
    return textureLod(u_clean, place, 0.0).r;
}

void main() {
    vec4 sum_a = vec4(0.0), sum_b = vec4(0.0);
    vec2 texel = 1.0 / vec2(textureSize(u_clean, 0)), pixel = floor(gl_FragCoord.xy);
    vec2 at = gl_FragCoord.xy * texel;
    float own_depth = clean_at(at); // and those of the four neighbours, clamped at the border of the frame
    vec2 right = vec2(texel.x, 0.0), down = vec2(0.0, texel.y);
    vec4 beside = vec4(clean_at(at - down), clean_at(at - right), clean_at(at + down), clean_at(at + right));
    float depth = max(own_depth, 1.0), even_m = 0.001 * smooth_mm * depth * depth;
    bool mixed = u_supersample > 1 && textureLod(u_uneven, at, 0.0).r > even_m;
    int side = u_supersample, samples = mixed ? side * side : 1;
    float share = 1.0 / float(samples), width = 1.0 / float(side); // of a sample; width in pixels
    vec2 ray = textureLod(u_rays, at, 0.0).rg;
    Harmonics harmonics = device_harmonics();
    int k = 0;
    ivec2 place = mixed ? ivec2(0) : ivec2(side / 2);
    do { // an even pixel has one sample, the central one
        vec2 within = (vec2(place) + 0.5) * width;
        vec2 seen = textureLod(u_fine_seen, (pixel + within) * texel, 0.0).rg;
        // Light and normal change slowly on a surface: a sample takes those of its pixel or of one of
        // the four neighbours, whichever has the most similar depth.
        vec4 apart = mix(vec4(1e5), abs(beside - seen.r), greaterThan(beside, vec4(0.0)));
        float own = own_depth > 0.0 ? abs(own_depth - seen.r) : 1e5;
        float nearest = mixed ? min(min(apart.x, apart.y), min(apart.z, apart.w)) : 1e5;
        vec2 way = apart.z <= nearest ? down : right;
        way = apart.x <= nearest ? -down : (apart.y <= nearest ? -right : way);
        vec2 alike = own < nearest || !mixed ? at : at + way;
        nearest = min(nearest, own);
        // Without such a pixel, the sample is lit and faces the camera; a strand does not take them from a wall.
        nearest = seen.g < 0.0 && nearest > 0.1 * seen.r ? 1e5 : nearest;
        vec4 shape = textureLod(u_normal, alike, 0.0);
        float lit = textureLod(u_lit, alike, 0.0).r;
        shape = nearest < 1e5 ? shape : vec4(0.0, 0.0, -1.0, 0.0);
        lit = nearest < 1e5 ? lit : 1.0;
        shape.w = mixed ? abs(seen.g) : shape.w; // strands have negative albedos
        vec2 aside = (within - 0.5) / u_focal_px;
        vec2 light = surface_light(seen.r, shape, ray + aside, lit);
        light.x *= share;
        vec3 real, imaginary;
        correlate(light.y, harmonics, real, imaginary);
        vec3 left = contrast(lit);
        real *= left;
        imaginary *= left;
        sum_a += light.x * vec4(real.x, imaginary.x, real.y, imaginary.y);
        sum_b += vec4(light.x * real.z, light.x * imaginary.z, light.x, 0.0);
        // No division of whole numbers: a software rasteriser makes it pixel by pixel.
        place = place.x + 1 < side ? ivec2(place.x + 1, place.y) : ivec2(0, place.y + 1);
    } while (++k < samples);
    light_a = sum_a;
    light_b = sum_b;
#ifdef EXPECTED
    expected = expected_depth(own_depth, ray, harmonics);
#endif
}
