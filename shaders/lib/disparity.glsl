// disparity: depth, m, to the shift between camera and projector, px, and back.
// u_focal_baseline_px_m is focal length times baseline; a sensor without a baseline has no disparity.
#include "lib/depth.glsl"

uniform float u_focal_baseline_px_m;

float disparity_px(float depth_m) {
    return u_focal_baseline_px_m / depth_m;
}

// Moves a depth by millimetres and by pixels of disparity.
float displaced(float depth_m, float by_mm, float by_px) {
    if (depth_m <= 0.0 || by_px == 0.0) return moved_by_mm(depth_m, by_mm);
    float moved = u_focal_baseline_px_m / max(disparity_px(depth_m) + by_px, 1e-3);
    return moved_by_mm(moved, by_mm);
}
