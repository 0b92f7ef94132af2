// dots: the projected pattern, one dot per 3x3 cell, at a place chosen by a hash.
// The density is that of BlenSor's and render_kinect's pattern images, 1/9; the pattern is our own.
#include "lib/random.glsl"

const int CELL_PX = 3;

// The pixel of a cell that has the dot, 0 to 8 in reading order.
int dot_place(ivec2 cell) {
    return int(random_bits(cell, 0xd075u, 0u).x % 9u);
}

ivec2 place_pixel(ivec2 cell, int place) {
    return cell * CELL_PX + ivec2(place % CELL_PX, place / CELL_PX);
}

ivec2 dot_pixel(ivec2 cell) {
    return place_pixel(cell, dot_place(cell));
}
