#version 330 core
// centres: the layers of a pixel from those of its samples: the sample at the pixel's centre, or the
// median of the samples where one of them is a strand of hair, and its largest difference from the others. The albedo is the mean of the samples on the surface at the
// centre: a pixel sees an area, and the edge of a print is as wide as that.
uniform sampler2D u_fine_seen; // depth, albedo; a strand's albedo is negative
uniform sampler2D u_rays;
uniform vec2 u_focal_px;

const int SIDE = SAMPLES_PER_AXIS; // the rig's samples along each axis of a pixel, defined by glsim

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

bool strands_in(vec2 middle, vec2 texel) {
    bool some = false;
    for (int k = 0; k < SIDE * SIDE; k++) {
        vec2 offset = vec2(k % SIDE, k / SIDE) - float(SIDE / 2);
        some = some || textureLod(u_fine_seen, middle + offset * texel, 0.0).g < 0.0;
    }
    return some;
}

// The sample that as many samples are nearer than as are farther; nothing is farthest.
vec2 median_sample(vec2 middle, vec2 texel) {
    vec2 samples[SIDE * SIDE], chosen = vec2(0.0);
    for (int k = 0; k < SIDE * SIDE; k++) {
        vec2 offset = vec2(k % SIDE, k / SIDE) - float(SIDE / 2);
        samples[k] = textureLod(u_fine_seen, middle + offset * texel, 0.0).rg;
        samples[k].r = samples[k].r > 0.0 ? samples[k].r : 1e6;
    }
    for (int k = 0; k < SIDE * SIDE; k++) {
        int nearer = 0;
        for (int j = 0; j < SIDE * SIDE; j++)
            nearer += int(samples[j].r < samples[k].r || samples[j].r == samples[k].r && j < k);
        chosen = nearer == SIDE * SIDE / 2 ? samples[k] : chosen;
    }
    return chosen.r < 1e6 ? chosen : vec2(0.0);
}

void main() {
    vec2 texel = 1.0 / vec2(textureSize(u_fine_seen, 0));
    vec2 middle = floor(gl_FragCoord.xy) * float(SIDE) + 0.5 * float(SIDE);
    vec2 seen = textureLod(u_fine_seen, middle * texel, 0.0).rg;
    if (strands_in(middle * texel, texel)) seen = median_sample(middle * texel, texel);
    clean = seen.r;
    float low = clean, high = clean, sum = 0.0;
    float print = 0.0, same = 0.0; // sum of the albedos on the surface, and their number
    float left = clean, right = clean, above = clean, below = clean; // the samples beside the middle
    const int REACH = SIDE / 2;
    for (int y = -REACH; y <= REACH; y++) {
        for (int x = -REACH; x <= REACH; x++) {
            vec2 sample_seen = textureLod(u_fine_seen, (middle + vec2(x, y)) * texel, 0.0).rg;
            float z = sample_seen.r;
            if (z > 0.0 && abs(z - clean) < EDGE_SHARE * clean) {
                print += abs(sample_seen.g);
                same += 1.0;
            }
            low = min(low, z);
            high = max(high, z);
            sum += z;
            if (y == 0 && x == -1) left = z;
            if (y == 0 && x == 1) right = z;
            if (x == 0 && y == -1) above = z;
            if (x == 0 && y == 1) below = z;
        }
    }
    uneven = abs(sum / float(SIDE * SIDE) - clean) + SHARE_OF_RANGE * (high - low);
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
