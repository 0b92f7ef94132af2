#version 330 core
// lens: resamples the clean layers from the pinhole grid to the grid of a lens with distortion.
// Each pixel takes the surface element that its true ray meets. Its depth is where the ray meets the
// plane of the element: planes stay planes.
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
    // On a grazing facet half a pixel may leave the facet: limit the change of depth.
    clean = depth * clamp(ratio, 0.98, 1.02);
}
