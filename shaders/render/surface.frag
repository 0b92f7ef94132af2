#version 330 core
// surface: the clean layers. Depth is the interpolated camera-space z, not the depth buffer's.
in vec3 v_position_m;
in float v_albedo;

out float clean;
out vec4 normal;
out float albedo;

void main() {
    // The facet's own normal: both derivatives lie in the plane of the triangle.
    vec3 n = normalize(cross(dFdx(v_position_m), dFdy(v_position_m)));
    if (dot(n, v_position_m) > 0.0) n = -n;
    clean = v_position_m.z;
    normal = vec4(n, 0.0);
    albedo = v_albedo;
}
