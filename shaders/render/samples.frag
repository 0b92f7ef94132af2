#version 330 core
// samples: the surface on a grid finer than the pixels, in as few numbers as will do.
in vec3 v_position_m;
in float v_albedo;

out vec2 fine_seen; // depth, albedo

void main() {
    fine_seen = vec2(v_position_m.z, v_albedo);
}
