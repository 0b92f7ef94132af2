#version 330 core
// tof_shadow: computes the share of three emitters that lights a pixel, by ray marching in the image.
// The line from a point to an emitter beside the camera runs through the image along the baseline;
// after k pixels its depth is 1 / (1 / z + k / F), F the focal length times the baseline (the width
// of shadows, F (1 / z_near - 1 / z_far), follows from it). A surface at that depth or in front of it,
// by no more than the thickness of objects or the line's step from pixel to pixel, hides the point.
// It needs one image instead of a z-buffer per emitter.
//@ sparse
uniform float spread_mm = 15.0;     //@ [0, 100]  mm distance of the outer emitters from the middle one; not published
uniform float thickness_mm = 250.0; //@ [1, 5000] mm assumed thickness of objects; the depth of a head
uniform float bias_mm = 1.0;        //@ [0, 50]   mm a surface hides a point if it is nearer than the line by this

#include "lib/loops.glsl"

uniform sampler2D u_clean;
uniform vec3 u_emitter_m;
uniform float u_focal_baseline_px_m;
uniform float u_nearest_m; // smallest depth of the scene: nothing nearer casts a shadow

const int FARTHEST_PX = 128;

out float lit;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), size = textureSize(u_clean, 0);
    float z = texelFetch(u_clean, pixel, 0).r;
    float baseline = max(length(u_emitter_m), 1e-6);
    vec2 towards = u_emitter_m.xy / max(length(u_emitter_m.xy), 1e-6);
    vec3 offsets = 1.0 + 0.001 * spread_mm / baseline * vec3(-1.0, 0.0, 1.0);
    vec3 reach = u_focal_baseline_px_m * offsets;
    // An emitter at the camera casts no shadow; one on its other side is not on this line.
    vec3 step_per_px = 1.0 / max(reach, 1e-3);
    float bias = 0.001 * bias_mm, thickness = 0.001 * thickness_mm;
    float inverse = 1.0 / max(z, 1e-3);
    vec3 hidden = vec3(0.0);
    float nearest = 1.0 / max(u_nearest_m, 1e-3);
    bool walking = inverse < nearest;
    int k = 1;
    do {
        vec3 line = inverse + float(k) * step_per_px; // 1 / depth of the line to each emitter
        ivec2 at = ivec2(floor(vec2(pixel) + 0.5 + float(k) * towards));
        bool inside = all(greaterThanEqual(at, ivec2(0))) && all(lessThan(at, size));
        float there = inside ? texelFetch(u_clean, at, 0).r : 0.0;
        float surface = 1.0 / max(there, 1e-3);
        // How far the surface is in front of the line, times both inverse depths.
        vec3 before = surface - line, scale = surface * line;
        vec3 deepest = max(thickness * scale, bias * scale + step_per_px);
        vec3 hides = step(bias * scale, before) * (1.0 - step(deepest, before));
        hidden = max(hidden, there > 0.0 ? hides : vec3(0.0));
        walking = walking && inside && min(line.x, min(line.y, line.z)) < nearest;
    } while (walking && ++k <= FARTHEST_PX);
    lit = z > 0.0 ? 1.0 - dot(hidden, vec3(1.0 / 3.0)) : 0.0;
}
