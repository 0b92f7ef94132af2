#version 330 core
// any_camera_edges: measures silhouettes, shadows and light as some unknown depth camera would.
// Domain randomisation (docs/howto/any_camera.md): the parameters choose between the rules that real
// cameras follow at depth steps. First stage of its chain: it measures the clean surface anew.
#include "lib/lattice_noise.glsl"
#include "lib/skin_signal.glsl"
#include "lib/loops.glsl"
#include "reason.glsl"

uniform float growth_px = 0.5;        //@ [-2, 2.5] px how far surfaces grow over what is behind them; below 0 they shrink. Within 5x5 pixels
uniform float rough_px = 0.3;         //@ [0, 2]    px standard deviation of the growth along a silhouette
uniform float rough_length_px = 2.0;  //@ [1, 16]   px length of the bumps of a silhouette
uniform float edge_holes = 0.5;       //@ [0, 1]    1  share of the pixels of a shrunken rim that are lost; the others see what is behind
uniform float cut_px = 0.5;           //@ [0, 2.5]  px width of the band behind a silhouette that is lost
uniform float step_mm_per_m = 25.0;   //@ [1, 500]  mm/m difference in depth, per distance, that makes a silhouette
uniform float psf_px = 0.4;           //@ [0, 1.5]  px standard deviation of the light that a pixel collects; mixes the two sides of a silhouette
uniform float wavelength_m = 4.0;     //@ [0.5, 1e4] m mixed pixels add phasors that repeat after this depth; a large number averages depths
uniform float light_mix = 1.0;        //@ [0, 1]    1  1: bright surfaces count more in a mixed pixel, as in time of flight; 0: areas count, as in stereo
uniform float max_mixed = 0.3;        //@ [0, 1]    1  share of another surface beyond which a mixed pixel is rejected
uniform float haze = 0.005;           //@ [0, 0.1]  1  share of the surroundings' light in every pixel: pulls its depth towards theirs
uniform float haze_px = 5.0;          //@ [1, 6]    px radius of these surroundings
uniform float shadow_lit = 0.5;       //@ [0, 1]    1  share of the emitter's light below which a pixel is in shadow
uniform float shadow_kept = 0.1;      //@ [0, 1]    1  share of the pixels in shadow that have a depth
uniform float shadow_between = 0.2;   //@ [0, 1]    1  share of these that lie between the occluder and what is behind it; the others are behind
uniform float gain_counts = 1000.0;   //@ [0, 65535] counts infrared of skin at 0.9 m
uniform float shot_counts = 5.0;      //@ [0, 1000] counts variance of the infrared per count
uniform float read_counts = 30.0;     //@ [0, 5000] counts standard deviation of the infrared in the dark

uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform sampler2D u_albedo;
uniform sampler2D u_lit;
uniform sampler2D u_rays;
uniform uint u_seed;

out float depth;
out float reason;
out float infrared;

const float FAR = 1e4, MOST_HAZE_M = 0.04, TWO_PI = 6.28318530718;

// The pixel in the frame that is nearest to one beside it.
ivec2 inside(ivec2 pixel) {
    return clamp(pixel, ivec2(0), textureSize(u_clean, 0) - 1);
}

// Light of a surface that faces the sensor.
float brightness(ivec2 at, float z) {
    return skin_signal(z, texelFetch(u_albedo, at, 0).r, vec3(0.0, 0.0, -1.0), vec2(0.0));
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float clean = texelFetch(u_clean, pixel, 0).r;
    float step_m = 0.001 * step_mm_per_m * clean;
    float bumps = lattice_noise(pixel, vec2(rough_length_px), u_seed);
    float fraction = normal_share(bumps) - 0.5; // where in a pixel the silhouette runs
    float growth = growth_px + rough_px * bumps + fraction;

    // Nearest pixels of surfaces in front and behind; distances are from a pixel's centre to the
    // side of the other pixel.
    float to_front = FAR, to_behind = FAR, front = FAR, behind = 0.0;
    int k = 0;
    do {
        ivec2 offset = ivec2(k % 5, k / 5) - 2;
        float away = length(vec2(offset)) - 0.5;
        float there = texelFetch(u_clean, inside(pixel + offset), 0).r;
        bool nearer = there > 0.0 && (clean <= 0.0 || there < clean - step_m);
        bool farther = clean > 0.0 && (there <= 0.0 || there > clean + step_m);
        front = nearer && away <= growth ? min(front, there) : front;
        to_front = nearer ? min(to_front, away) : to_front;
        behind = farther && away < to_behind ? there : behind;
        to_behind = farther ? min(to_behind, away) : to_behind;
    } while (++k < 25);
    uvec4 chance = random_bits(pixel, u_seed, 1u);
    bool grows = front < FAR;
    bool shrinks = !grows && to_behind <= -growth;
    bool cut = !grows && clean > 0.0 && cut_px > 0.0 && to_front <= max(growth, 0.0) + cut_px;
    bool lost = shrinks && (behind <= 0.0 || uniform01(chance.x) < edge_holes);
    float own = grows ? front : (shrinks ? behind : clean);

    // A pixel beside a step collects light of both sides.
    bool mixes = min(to_front, to_behind) < FAR && psf_px > 0.0;
    float total = 0.0, alike = 0.0, area = 0.0, light = 0.0, cosines = 0.0, sines = 0.0;
    float falls = -0.5 / max(psf_px * psf_px, 1e-6), own_step = 0.001 * step_mm_per_m * own;
    int i = mixes ? 0 : 24;
    do {
        ivec2 offset = mixes ? ivec2(i % 5, i / 5) - 2 : ivec2(0);
        ivec2 at = inside(pixel + offset);
        float there = texelFetch(u_clean, at, 0).r, bright = brightness(at, there);
        float share = exp(falls * dot(vec2(offset), vec2(offset)));
        float weight = there > 0.0 ? share * mix(1.0, bright, light_mix) : 0.0;
        float angle = TWO_PI * (there - own) / wavelength_m;
        cosines += weight * cos(angle);
        sines += weight * sin(angle);
        total += weight;
        alike += abs(there - own) <= own_step ? weight : 0.0;
        area += share;
        light += share * bright;
    } while (++i < 25);
    float mixed = mixes && own > 0.0 ? 1.0 - alike / max(total, 1e-6) : 0.0;
    float blended = own + atan(sines, cosines) * wavelength_m / TWO_PI;
    bool rejected = mixed > max_mixed;
    float z = mixed > 0.0 ? max(blended, 0.05) : own;

    // Haze: the ring of the surroundings.
    float around = 0.0, pull = 0.0, least = clean;
    int h = haze > 0.0 || shadow_between > 0.0 ? 0 : 7;
    do {
        vec2 way = vec2(cos(0.785398163 * float(h)), sin(0.785398163 * float(h)));
        ivec2 at = inside(pixel + ivec2(floor(haze_px * ((h & 1) == 0 ? 1.0 : 0.6) * way + 0.5)));
        float there = texelFetch(u_clean, at, 0).r, bright = brightness(at, there);
        around += 0.125 * bright;
        pull += 0.125 * bright * (there - z);
        least = there > 0.0 ? min(least, there) : least;
    } while (++h < 8);
    float moved = haze * pull / max(light / area + haze * around, 1e-3);
    z += own > 0.0 ? clamp(moved, -MOST_HAZE_M, MOST_HAZE_M) : 0.0;

    bool shadowed = !grows && clean > 0.0 && texelFetch(u_lit, pixel, 0).r < shadow_lit;
    bool kept = uniform01(chance.y) < shadow_kept;
    bool between = shadowed && uniform01(chance.z) < shadow_between;
    z = between ? mix(z, least, uniform01(chance.w)) : z;

    bool other = abs(z - clean) > max(own_step, step_m);
    reason = clean <= 0.0 ? REASON_GROWN : (other ? REASON_MOVED : REASON_VALID);
    if (rejected) reason = REASON_MIXED;
    if (lost || cut) reason = REASON_EDGE;
    if (shadowed && !kept) reason = REASON_SHADOW;
    if (own <= 0.0) reason = clean > 0.0 ? REASON_EDGE : REASON_NO_SURFACE;
    bool valid = reason == REASON_VALID || reason == REASON_MOVED || reason == REASON_GROWN;
    depth = valid ? z : 0.0;

    vec2 ray = texelFetch(u_rays, pixel, 0).rg;
    vec3 direction = vec3(ray, 1.0);
    float squared = dot(direction, direction);
    float facing = max(-dot(texelFetch(u_normal, pixel, 0).xyz, direction), 0.0);
    facing = clean > 0.0 ? facing * inversesqrt(squared) * texelFetch(u_lit, pixel, 0).r : 1.0;
    float counts = gain_counts * light / area * facing / squared;
    float noise = normal_pair(random_bits(pixel, u_seed, 2u).xy).x;
    float sigma = sqrt(read_counts * read_counts + shot_counts * counts);
    infrared = clamp(floor(counts + sigma * noise + 0.5), 0.0, 65535.0);
}
