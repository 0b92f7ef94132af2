#version 330 core
// axial: adds white Gaussian noise along the axis; sigma grows with distance and surface angle.
// Defaults: Kinect V2 indoors, Fankhauser et al., ICAR 2015:
//   sigma_mm = 1.5 - 0.5 z + 0.3 z^2 + 0.1 z^1.5 a^2 / (pi/2 - a)^2,  z in m, a in rad.
// Kinect V1 (Nguyen, Izadi, Lovell, 3DIMPVT 2012) has the same form, see sensors/kinect-v1.toml.
#include "lib/random.glsl"
#include "lib/depth.glsl"

uniform float base_sigma_mm = 1.5;      //@ [0, 100]   mm     constant term of the standard deviation
uniform float linear_mm_per_m = -0.5;   //@ [-20, 20]  mm/m   term linear in distance
uniform float quadratic_mm_per_m2 = 0.3;//@ [0, 50]    mm/m^2 term quadratic in distance
uniform float quadratic_from_m = 0.0;   //@ [0, 5]     m      distance at which the quadratic term is 0
uniform float angle_mm = 0.1;           //@ [0, 20]    mm     size of the angle term at 1 m
uniform float angle_power = 1.5;        //@ [-2, 3]    1      power of the distance in the angle term
uniform float angle_from_deg = 0.0;     //@ [0, 90]    deg    angle below which the angle term is 0
uniform float max_sigma_mm = 20.0;      //@ [0, 1000]  mm     upper limit: the angle term has a pole at 90 deg

uniform sampler2D u_depth;
uniform sampler2D u_normal;
uniform uint u_seed;

out float depth;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float z = texelFetch(u_depth, pixel, 0).r;
    float angle = acos(clamp(-texelFetch(u_normal, pixel, 0).z, 0.0, 1.0));
    float beyond = z - quadratic_from_m;
    float sigma = base_sigma_mm + linear_mm_per_m * z + quadratic_mm_per_m2 * beyond * beyond;
    if (z > 0.0 && degrees(angle) >= angle_from_deg) {
        float ratio = angle / max(1.57079632679 - angle, 1e-3);
        sigma += angle_mm * pow(z, angle_power) * ratio * ratio;
    }
    float noise = normal_pair(random_bits(pixel, u_seed, 0u).xy).x;
    depth = moved_by_mm(z, clamp(sigma, 0.0, max_sigma_mm) * noise);
}
