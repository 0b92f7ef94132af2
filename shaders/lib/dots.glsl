// dots: the projected pattern, one dot in each 3x3 cell at a place that a hash decides.
// The density is that of BlenSor's and render_kinect's pattern images, 1/9; the pattern is our own.
#include "lib/random.glsl"

const int CELL_PX = 3;

ivec2 dot_pixel(ivec2 cell) {
    int place = int(random_bits(cell, 0xd075u, 0u).x % 9u);
    return cell * CELL_PX + ivec2(place % CELL_PX, place / CELL_PX);
}
