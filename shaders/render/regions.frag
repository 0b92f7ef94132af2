#version 330 core
// regions: writes the region of the face that a pixel shows.
flat in float v_region;

out float region;

void main() {
    region = v_region;
}
