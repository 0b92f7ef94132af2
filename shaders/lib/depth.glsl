// depth: moves a depth along the axis.

// 0 (no depth) stays 0; any other depth stays above 0, however far it is moved.
float moved_by_mm(float depth_m, float by_mm) {
    return depth_m > 0.0 ? max(depth_m + 0.001 * by_mm, 1e-4) : 0.0;
}
