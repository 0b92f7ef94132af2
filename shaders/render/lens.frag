#version 330 core
// lens: clean layers from the pinhole grid to the grid of a lens that distorts.
// Each pixel takes the surface element that its true ray meets, and the depth at which the ray
// meets the element's plane, so that a plane stays a plane.
uniform sampler2D u_pinhole_clean;
uniform sampler2D u_pinhole_normal;
uniform sampler2D u_pinhole_albedo;
uniform sampler2D u_rays;
uniform vec4 u_pinhole; // fx, fy, cx, cy

out float clean;
out vec4 normal;
out float albedo;

void main() {
    vec2 ray = texelFetch(u_rays, ivec2(gl_FragCoord.xy), 0).rg;
    ivec2 source = ivec2(floor(ray * u_pinhole.xy + u_pinhole.zw));
    float depth = texelFetch(u_pinhole_clean, source, 0).r;
    vec4 n = texelFetch(u_pinhole_normal, source, 0);
    clean = 0.0;
    normal = n;
    albedo = texelFetch(u_pinhole_albedo, source, 0).r;
    if (depth <= 0.0) return;
    vec2 at = (vec2(source) + 0.5 - u_pinhole.zw) / u_pinhole.xy;
    float ratio = dot(n.xyz, vec3(at, 1.0)) / dot(n.xyz, vec3(ray, 1.0));
    // Half a pixel of a grazing facet may leave the facet: stay within its pixel's depth.
    clean = depth * clamp(ratio, 0.98, 1.02);
}
