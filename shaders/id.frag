#version 330
// The splat's row + 1 as an integer; 0 stays for "nothing here".

#include "falloff.glsl"

uniform float alpha_cut;

out uint row_plus_one;

void main() {
    if (fragment_alpha() < alpha_cut) {
        discard;
    }
    row_plus_one = splat_row + 1u;
}
