// projected_dots: the light of a projector's dots on a surface, as an imager sees it.
// One dot lies in each cell of a square grid of directions from the projector, at a place drawn by a hash. A sensor
// with an image of its pattern (rig.projector_image) throws that instead.
#include "lib/random.glsl"
#include "lib/layers.glsl"

uniform float gain_counts = 900.0;      //@ [0, 65535; 0, 2000] counts light between a dot's centre and its surroundings on white paper at 1 m, facing the projector; chosen: cameras expose automatically
uniform float ambient_counts = 40.0;     //@ [0, 65535; 0, 400] counts light of the room on white paper that faces up; a fifth of it faces down, 3/5 upright. Chosen
uniform float daylight = 0.0;           //@ [0, 2; 0, 1] W/m^2/nm irradiance of daylight on the scene around 850 nm; scene.daylight sets it
// A D435's imagers have no filter. Its projector throws 150 mW into 90x63 degrees, 0.10 W/m^2 at 1 m; the sun has 0.89
// W/m^2/nm at 850 nm, 430 W/m^2 from 400 to 700 nm, where the imager sees twice as well (chosen), and 264 W/m^2 from there to 1000 nm.
uniform float daylight_counts = 1.6e6;  //@ [0, 1e8]   counts light on white paper that faces up for a daylight of 1 W/m^2/nm; derived: the sun's light over the projector's mean light of 126 counts
uniform float daylight_texture = 0.5;   //@ [0, 1]     1    grain of surfaces in daylight, as texture_share: where dots drown, cameras match pores and cloth. Chosen, as for a D405
uniform float shortest_exposure = 1.2e-4; //@ [1e-5, 1] 1   automatic exposure shortens by no more than this factor in daylight: librealsense sets 1 us, 8,500 us are usual. Firmware of 2018 stopped at 20 us, 0.0024, and owners were overexposed in the sun (librealsense issues 1070, 2875)
uniform float flood = 0.1;              //@ [0, 1]      1    the projector's light between its dots over that at a dot's centre; with the ambient light it makes the contrast of 0.5 that a real D435's dots have on cardboard
uniform float dot_spacing_mrad = 23.9;  //@ [2, 200]    mrad distance of dots, tangent of the angle times 1000; measured on a D435's infrared image: 9.7 dots per 1000 px at f = 424 px
uniform float dot_sigma_mrad = 2.0;     //@ [0.3, 20]   mrad size of a dot, standard deviation; with the imager's blur 1.2 px, as measured on the same image
uniform float dot_disorder = 0.9;       //@ [0, 0.9]    1    part of its cell in which a dot's place is drawn; measured: no lattice is seen; 0 is a lattice
uniform float dot_variation = 0.4;      //@ [0, 1]      1    dots differ in brightness by up to this share, even distribution; chosen
uniform float fall_off_power = 1.0;     //@ [0, 16]     1    the light falls with this power of the cosine to the projector's axis, besides distance and angle of incidence; chosen

uniform float texture_share = 0.0;      //@ [0, 1]      1    grain of surfaces: their albedo varies by up to this share; cameras without a projector see pores and cloth. It does not move with the surface
uniform float texture_mm = 1.5;         //@ [0.1, 100; 0.5, 10] mm size of a grain nearer than 0.5 m, twice as large from there on, four times from 1 m, and so on

uniform uint u_device_seed;
uniform uint u_sequence_seed;
uniform float u_subject_m;
uniform vec3 u_emitter_1_m;
uniform vec3 u_emitter_2_m;

// Brightness of a pattern in a direction from its projector: 1 at the centre of a mean dot.
float dots(vec2 tangent, uint key) {
    float spacing = 0.001 * dot_spacing_mrad;
    vec2 place = tangent / spacing;
    ivec2 first = ivec2(floor(place - 0.5));
    float narrowness = -0.5 * (dot_spacing_mrad / dot_sigma_mrad) * (dot_spacing_mrad / dot_sigma_mrad);
    float sum = 0.0;
    for (int y = 0; y < 2; y++) {
        for (int x = 0; x < 2; x++) { // a dot of another cell is at least half a cell away
            ivec2 cell = first + ivec2(x, y);
            uint word = pcg_word(uint(cell.x) + pcg_word(uint(cell.y) + key));
            vec2 drawn = vec2(float(word & 2047u), float((word >> 11u) & 2047u)) / 2047.0 - 0.5;
            vec2 offset = place - (vec2(cell) + 0.5 + dot_disorder * drawn);
            float brightness = 1.0 + dot_variation * (2.0 * float(word >> 22u) / 1023.0 - 1.0);
            sum += brightness * exp(narrowness * dot(offset, offset));
        }
    }
    return sum;
}

#ifdef PROJECTOR_IMAGE
uniform sampler2D u_projector_image; // brightness, 0 to 1
uniform vec2 u_projector_tan;        // half of its field of view, tangents

// Brightness of the image in a direction, between its pixels; negative outside of its field of view.
float image_brightness(vec2 tangent) {
    ivec2 size = textureSize(u_projector_image, 0);
    vec2 place = (0.5 * tangent / u_projector_tan + 0.5) * vec2(size);
    if (any(lessThan(place, vec2(0.0))) || any(greaterThan(place, vec2(size)))) return -1.0;
    vec2 corner = floor(place - 0.5);
    vec2 part = place - 0.5 - corner;
    ivec2 first = clamp(ivec2(corner), ivec2(0), size - 1);
    ivec2 last = clamp(ivec2(corner) + 1, ivec2(0), size - 1);
    float upper = mix(texelFetch(u_projector_image, first, 0).r,
        texelFetch(u_projector_image, ivec2(last.x, first.y), 0).r, part.x);
    float lower = mix(texelFetch(u_projector_image, ivec2(first.x, last.y), 0).r,
        texelFetch(u_projector_image, last, 0).r, part.x);
    return mix(upper, lower, part.y);
}
#endif

// Brightness of what a projector throws in a direction: 1 is a mean dot's centre, negative outside of its view.
float thrown(vec2 tangent, uint key) {
#ifdef PROJECTOR_IMAGE
    return image_brightness(tangent);
#else
    return dots(tangent, key);
#endif
}

// Irradiance by one projector, whose light reaches the point by the share ``lit``.
float projected(vec3 point, vec3 normal, vec3 emitter, float lit, uint key) {
    vec3 way = point - emitter;
    float squared = dot(way, way);
    float facing = max(-dot(normal, way) * inversesqrt(squared), 0.0);
    float brightness = thrown(way.xy / way.z, key);
    if (brightness < 0.0) return 0.0;
    float pattern = flood + (1.0 - flood) * brightness;
    float cosine = way.z * inversesqrt(squared);
    return lit * facing / squared * pattern * pow(cosine, fall_off_power);
}

// Grain of the surface at a point, -1 to 1: random values at the corners of cubes, interpolated.
// The size doubles from distance to distance, 0.5, 1, 2 m: surfaces have texture of all sizes.
float grain(vec3 point) {
    float size_mm = texture_mm * exp2(floor(log2(max(2.0 * point.z, 1.0))));
    vec3 place = point * 1000.0 / size_mm;
    ivec3 cell = ivec3(floor(place));
    vec3 part = place - vec3(cell);
    float sum = 0.0;
    for (int corner = 0; corner < 8; corner++) {
        ivec3 at = ivec3(corner & 1, (corner >> 1) & 1, corner >> 2);
        vec3 near = mix(1.0 - part, part, vec3(at));
        at += cell;
        uint word = pcg_word(uint(at.x) + pcg_word(uint(at.y) + pcg_word(uint(at.z) + u_sequence_seed)));
        sum += near.x * near.y * near.z * (2.0 * uniform01(word) - 1.0);
    }
    return sum;
}

// Light, counts, that an imager gets of a surface.
// shape: normal and albedo; lit: the share of the light of each projector; point: camera frame, m.
float imaged_light(float depth, vec4 shape, vec2 lit, vec3 point) {
    if (depth <= 0.0) return 0.0;
    uint key = pcg_word(u_device_seed);
    float light = lit.x > 0.0 ? projected(point, shape.xyz, u_emitter_1_m, lit.x, key) : 0.0;
    if (lit.y > 0.0) light += projected(point, shape.xyz, u_emitter_2_m, lit.y, key + 1u);
    float albedo = shape.w;
    float share = daylight > 0.0 ? max(texture_share, daylight_texture) : texture_share;
    if (share > 0.0) albedo *= 1.0 + share * grain(point);
    float sky = ambient_counts + daylight * daylight_counts;
    // Automatic exposure (lib/imager_exposure.glsl) lengthens with the face's distance; it heeds daylight too.
    float longer = min(u_subject_m * u_subject_m, 4.0);
    float size = dot_sigma_mrad / dot_spacing_mrad;
    float usual = gain_counts * (flood + (1.0 - flood) * 6.2831853 * size * size) + 0.6 * ambient_counts;
    float shorter = daylight > 0.0 ? max(usual / (usual + longer * 0.6 * daylight * daylight_counts), shortest_exposure / longer) : 1.0;
    return shorter * albedo * (gain_counts * light + sky * (0.6 - 0.4 * shape.y));
}
