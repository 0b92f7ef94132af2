#version 330 core
// projector: nothing but the z-buffer.
void main() {
}
