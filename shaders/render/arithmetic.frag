#version 330 core
// arithmetic: functions whose last bits differ between drivers, see shader_arithmetic in glsim/gl/draw.py.
out vec4 numbers;
void main() {
    vec2 p = gl_FragCoord.xy;
    float x = 0.0137 * p.x + 0.171 * p.y + 0.001;
    float row = mod(floor(p.y), 4.0);
    if (row == 0.0) numbers = vec4(sin(x), cos(x), tan(0.1 * x), atan(x, 2.3));
    else if (row == 1.0) numbers = vec4(exp(-x), log(x), pow(x, 1.7), exp2(0.3 * x));
    else if (row == 2.0) numbers = vec4(sqrt(x), inversesqrt(x), 1.0 / x, x / (1.0 + x));
    else numbers = vec4(x * x + 0.1 * x, dot(vec3(x, p), p.yxy), length(vec3(x, p)), fract(91.7 * x));
}
