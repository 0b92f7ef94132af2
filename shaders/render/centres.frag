#version 330 core
// centres: the layers of a pixel from those of its samples: the middle one, which lies at the
// pixel's centre, and how wrong it would be to take it for all of them.
uniform sampler2D u_fine_clean;
uniform sampler2D u_fine_normal;
uniform sampler2D u_fine_albedo;
uniform int u_supersample;

// Light is brighter on one side of a pixel than on the other by some per cent; this moves the mean
// of the light within the pixel's range of depth by that much of the range.
const float SHARE_OF_RANGE = 0.005;

out float clean;
out vec4 normal;
out float albedo;
out float uneven; // m; 1 where some samples miss the surface

void main() {
    ivec2 first = ivec2(gl_FragCoord.xy) * u_supersample;
    ivec2 middle = first + u_supersample / 2;
    clean = texelFetch(u_fine_clean, middle, 0).r;
    normal = texelFetch(u_fine_normal, middle, 0);
    albedo = texelFetch(u_fine_albedo, middle, 0).r;
    float low = clean, high = clean, sum = 0.0;
    for (int y = 0; y < u_supersample; y++) {
        for (int x = 0; x < u_supersample; x++) {
            float z = texelFetch(u_fine_clean, first + ivec2(x, y), 0).r;
            low = min(low, z);
            high = max(high, z);
            sum += z;
        }
    }
    float samples = float(u_supersample * u_supersample);
    uneven = abs(sum / samples - clean) + SHARE_OF_RANGE * (high - low);
    if (low <= 0.0 && high > 0.0) uneven = 1.0;
}
