#version 330 core
// lens_regions: resamples regions to the grid of a lens with distortion: the nearest pixel.
uniform sampler2D u_pinhole_region;
uniform sampler2D u_rays;
uniform vec4 u_pinhole; // fx, fy, cx, cy

out float region;

void main() {
    vec2 ray = texelFetch(u_rays, ivec2(gl_FragCoord.xy), 0).rg;
    region = texelFetch(u_pinhole_region, ivec2(floor(ray * u_pinhole.xy + u_pinhole.zw)), 0).r;
}
