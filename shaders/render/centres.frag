#version 330 core
// centres: the layers of a pixel from those of its samples: the middle one, which lies at the
// pixel's centre, and how wrong it would be to take it for all of them.
uniform sampler2D u_fine_clean;
uniform sampler2D u_fine_normal;

const int SIDE = 3; // samples a pixel along each axis; the renderer puts in the rig's

// Light is brighter on one side of a pixel than on the other by some per cent; this moves the mean
// of the light within the pixel's range of depth by that much of the range.
const float SHARE_OF_RANGE = 0.005;

out float clean;
out vec4 normal;
out float albedo;
out float uneven; // m; 1 where some samples miss the surface

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * SIDE;
    clean = texelFetch(u_fine_clean, first + SIDE / 2, 0).r;
    // Outside of surfaces the shape is left from an earlier frame.
    vec4 shape = clean > 0.0 ? texelFetch(u_fine_normal, first + SIDE / 2, 0) : vec4(0.0);
    normal = shape;
    albedo = shape.w;
    float low = clean, high = clean, sum = 0.0;
    for (int y = 0; y < SIDE; y++) {
        for (int x = 0; x < SIDE; x++) {
            float z = texelFetch(u_fine_clean, first + ivec2(x, y), 0).r;
            low = min(low, z);
            high = max(high, z);
            sum += z;
        }
    }
    uneven = abs(sum / float(SIDE * SIDE) - clean) + SHARE_OF_RANGE * (high - low);
    if (low <= 0.0 && high > 0.0) uneven = 1.0;
}
