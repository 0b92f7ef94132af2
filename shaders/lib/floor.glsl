// floor: depth noise that does not depend on the light. Its cause is not known.
// The directions of the pixels are uncertain too, which moves the depth of slanted surfaces:
// Fankhauser et al. 2015 find twice the noise at 75 degrees that the reduced light explains.

uniform float sigma_mm = 1.12;  //@ [0, 50] mm standard deviation; bright surfaces in recordings have 1.05 to 1.26 mm of temporal noise, rounding to mm included
uniform float lateral_px = 0.1; //@ [0, 2]  px standard deviation of a pixel's direction; Fankhauser's curve at 75 degrees needs 0.3

uniform float u_focal_px;

const float STEEPEST = 12.0; // tangent of 85 degrees

// Variance, mm^2.
float floor_variance(float depth_m, vec3 normal, vec2 ray) {
    float slope = min(length(normal.xy) / max(-dot(normal, vec3(ray, 1.0)), 1e-3), STEEPEST);
    float slanted_mm = lateral_px * slope * 1000.0 * depth_m / u_focal_px;
    return sigma_mm * sigma_mm + slanted_mm * slanted_mm;
}
