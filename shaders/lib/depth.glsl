// depth: moving a depth along the axis.

// A pixel without depth stays without; one with depth keeps some, however far it is moved.
float moved_by_mm(float depth_m, float by_mm) {
    return depth_m > 0.0 ? max(depth_m + 0.001 * by_mm, 1e-4) : 0.0;
}
