#version 330 core
// centres: the layers of a pixel from those of its samples: the sample at the pixel's centre, or the
// median of the samples where one of them is a strand of hair, and its largest difference from the others.
// The albedo is the mean of the samples on the surface at the centre: a pixel sees an area, and the edge of a
// print is as wide as that.
uniform sampler2D u_fine_seen; // depth, albedo; a strand's albedo is negative
uniform sampler2D u_rays;
uniform vec2 u_focal_px;

const int SIDE = SAMPLES_PER_AXIS; // the rig's samples along each axis of a pixel, defined by glsim
const int COUNT = SIDE * SIDE;
const float FARTHEST = 1e6; // m; where a sample sees nothing

// Light is brighter on one side of a pixel than on the other by some per cent; this moves the mean
// of the light within the pixel's range of depth by that much of the range.
const float SHARE_OF_RANGE = 0.005;

// Samples whose depths differ by more than this share are on different surfaces: 84 degrees.
const float EDGE_SHARE = 0.01;

out float clean;
out vec4 normal; // and in w the albedo
out float albedo;
out float uneven; // m; 1 where some samples miss the surface, 0 where all do

// The way across the surface from one sample to the one two further, or to the next one on it.
vec3 tangent(float before, float here, float after, vec3 ray, vec3 step) {
    bool from = before > 0.0 && abs(before - here) < EDGE_SHARE * here;
    bool to = after > 0.0 && abs(after - here) < EDGE_SHARE * here;
    vec3 start = from ? before * (ray - step) : here * ray;
    vec3 end = to ? after * (ray + step) : here * ray;
    return from || to ? end - start : step;
}

// The sample that as many samples are nearer than as are farther; nothing is farthest.
// The loop is as lib/loops.glsl says: it goes on only where the middle is wanted and not yet found.
vec2 median_sample(vec2 samples[COUNT], bool wanted) {
    vec2 chosen = vec2(0.0);
    int nearer = 0;
    do {
        vec2 next = vec2(FARTHEST, 0.0);
        for (int k = 0; k < COUNT; k++) {
            float z = samples[k].r > 0.0 ? samples[k].r : FARTHEST;
            next = z > chosen.r && z < next.r ? samples[k] : next;
        }
        chosen = next;
        nearer = 0;
        for (int k = 0; k < COUNT; k++) nearer += int(samples[k].r > 0.0 && samples[k].r <= chosen.r);
    } while (wanted && chosen.r < FARTHEST && nearer <= COUNT / 2);
    return chosen.r < FARTHEST ? chosen : vec2(0.0);
}

void main() {
    vec2 texel = 1.0 / vec2(textureSize(u_fine_seen, 0));
    vec2 middle = floor(gl_FragCoord.xy) * float(SIDE) + 0.5 * float(SIDE);
    vec2 samples[COUNT];
    bool strands = false;
    for (int k = 0; k < COUNT; k++) {
        vec2 offset = vec2(k % SIDE, k / SIDE) - float(SIDE / 2);
        samples[k] = textureLod(u_fine_seen, (middle + offset) * texel, 0.0).rg;
        strands = strands || samples[k].g < 0.0;
    }
    vec2 chosen = median_sample(samples, strands), seen = strands ? chosen : samples[COUNT / 2];
    clean = seen.r;
    float low = clean, high = clean, sum = 0.0;
    float print = 0.0, same = 0.0; // sum of the albedos on the surface, and their number
    float left = samples[COUNT / 2 - 1].r, right = samples[COUNT / 2 + 1].r; // beside the middle
    float above = samples[COUNT / 2 - SIDE].r, below = samples[COUNT / 2 + SIDE].r;
    for (int k = 0; k < COUNT; k++) {
        float z = samples[k].r;
        if (z > 0.0 && abs(z - clean) < EDGE_SHARE * clean) {
            print += abs(samples[k].g);
            same += 1.0;
        }
        low = min(low, z);
        high = max(high, z);
        sum += z;
    }
    uneven = abs(sum / float(COUNT) - clean) + SHARE_OF_RANGE * (high - low);
    if (low <= 0.0 && high > 0.0) uneven = 1.0;
    if (high > 0.0) uneven = max(uneven, 1e-9);
    vec3 ray = vec3(texelFetch(u_rays, ivec2(gl_FragCoord.xy), 0).rg, 1.0);
    vec2 step = 1.0 / (float(SIDE) * u_focal_px);
    vec3 along_x = tangent(left, clean, right, ray, vec3(step.x, 0.0, 0.0));
    vec3 along_y = tangent(above, clean, below, ray, vec3(0.0, step.y, 0.0));
    vec3 n = cross(along_y, along_x) * inversesqrt(
        max(dot(cross(along_y, along_x), cross(along_y, along_x)), 1e-30));
    albedo = clean > 0.0 ? print / same : 0.0;
    n = seen.g < 0.0 ? -normalize(ray) : n;
    normal = clean > 0.0 ? vec4(dot(n, ray) > 0.0 ? -n : n, albedo) : vec4(0.0);
}
