#version 330 core
// field_stop: removes depth and infrared outside the lens's field of view: a hexagon within a circle.
// The hexagon lies in the image of the lens, with its distortion, at focal length 1; two of its sides
// are level. The circle is one of true directions.
//@ sparse
#include "reason.glsl"

uniform float side = 0.599;      //@ [0, 10]  1 distance of the hexagon's sides from its centre, over the focal length; 0: no hexagon; measured on the real frame of an Azure Kinect: 302 px
uniform float centre_x = -0.003; //@ [-1, 1]  1 the hexagon's centre to the right of the optical axis, over the focal length; the same frame: -1.3 px
uniform float centre_y = -0.096; //@ [-1, 1]  1 below the axis; the same frame: -48 px
uniform float widest_tan = 1.732; //@ [0, 100] 1 tangent of the largest angle to the axis (Microsoft: 120 degrees in all; the factory calibration holds to 1.74)

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_infrared;
uniform sampler2D u_rays;
uniform vec3 u_lens_upper; // k1, k2, k3
uniform vec3 u_lens_lower; // k4, k5, k6

out float depth;
out float reason;
out float infrared;

const float HALF = 0.5, HALF_ROOT_3 = 0.86602540378;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_depth, 0));
    depth = textureLod(u_depth, here, 0.0).r;
    reason = textureLod(u_reason, here, 0.0).r;
    infrared = textureLod(u_infrared, here, 0.0).r;
    vec2 ray = textureLod(u_rays, here, 0.0).rg;
    float r2 = dot(ray, ray);
    float upper = 1.0 + r2 * (u_lens_upper.x + r2 * (u_lens_upper.y + r2 * u_lens_upper.z));
    float lower = 1.0 + r2 * (u_lens_lower.x + r2 * (u_lens_lower.y + r2 * u_lens_lower.z));
    vec2 apart = abs(ray * (upper / lower) - vec2(centre_x, centre_y));
    float out_by = max(apart.y, HALF_ROOT_3 * apart.x + HALF * apart.y);
    if ((side > 0.0 && out_by > side) || r2 >= widest_tan * widest_tan) {
        depth = 0.0;
        infrared = 0.0;
        reason = reason == REASON_NO_SURFACE ? reason : REASON_LOW_SIGNAL;
    }
}
