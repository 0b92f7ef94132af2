#version 330 core
// regions: which part of the face a pixel shows.
flat in float v_region;

out float region;

void main() {
    region = v_region;
}
