#version 330 core
// projector: writes the z-buffer only.
void main() {
}
