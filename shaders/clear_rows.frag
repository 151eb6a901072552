#version 330
// No splat anywhere, as far away as the depth buffer goes.

out uint row_plus_one;

void main() {
    row_plus_one = 0u;
    gl_FragDepth = 1.0;
}
