#version 330
// Premultiplied colour (or depth) for back-to-front blending.

#include "falloff.glsl"

uniform float alpha_cut;
uniform bool show_depth;

out vec4 premultiplied;

void main() {
    float alpha = fragment_alpha();
    if (alpha < alpha_cut) {
        discard;
    }
    premultiplied = vec4(alpha * (show_depth ? vec3(depth) : color.rgb), alpha);
}
