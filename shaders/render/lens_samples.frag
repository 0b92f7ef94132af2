#version 330 core
// lens_samples: resamples samples to the grid of a lens with distortion: the nearest sample.
uniform sampler2D u_pinhole_seen;
uniform sampler2D u_rays;
uniform vec4 u_pinhole; // fx, fy, cx, cy of the samples
uniform vec2 u_focal_px;

const int SIDE = SAMPLES_PER_AXIS; // the rig's samples along each axis of a pixel, defined by glsim

out vec2 fine_seen;

void main() {
    ivec2 sample_at = ivec2(gl_FragCoord.xy);
    // Within a pixel the lens has no distortion.
    vec2 aside = (vec2(sample_at % SIDE) - float(SIDE / 2)) / float(SIDE);
    vec2 ray = texelFetch(u_rays, sample_at / SIDE, 0).rg + aside / u_focal_px;
    ivec2 source = ivec2(floor(ray * u_pinhole.xy + u_pinhole.zw));
    fine_seen = texelFetch(u_pinhole_seen, source, 0).rg;
}
