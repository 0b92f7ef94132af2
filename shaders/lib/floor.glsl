// floor: the noise of the depth that does not depend on the light. Where it comes from is not known.
// Where pixels look is a little uncertain too, which moves the depth of slanted surfaces: Fankhauser
// et al. 2015 find twice the noise at 75 degrees that less light explains.

uniform float sigma_mm = 1.1;   //@ [0, 50] mm standard deviation; on recordings 1.20 mm of temporal noise at 0.8 m, 0.4 of them from the light
uniform float lateral_px = 0.1; //@ [0, 2]  px standard deviation of where a pixel looks; at 75 degrees Fankhauser's curve asks for 0.3

uniform float u_focal_px;

const float STEEPEST = 12.0; // tangent of 85 degrees

// Variance, mm^2.
float floor_variance(float depth_m, vec3 normal, vec2 ray) {
    float slope = min(length(normal.xy) / max(-dot(normal, vec3(ray, 1.0)), 1e-3), STEEPEST);
    float slanted_mm = lateral_px * slope * 1000.0 * depth_m / u_focal_px;
    return sigma_mm * sigma_mm + slanted_mm * slanted_mm;
}
