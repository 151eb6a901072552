#version 330
// An opaque ellipse: dark inside, with a bright rim at the edge, where its alpha falls to `alpha_cut`.

#include "falloff.glsl"

uniform float alpha_cut;
uniform float rim;
uniform float inside;
uniform float rim_light;

out vec4 shown;

void main() {
    float alpha = fragment_alpha();
    if (alpha < alpha_cut) {
        discard;
    }
    vec2 offset = gl_FragCoord.xy - center;
    vec2 sigmas = vec2(dot(inverse_axes.xy, offset), dot(inverse_axes.zw, offset));
    float edge = 2.0 * log(max(color.a / alpha_cut, 1.0001));
    vec3 plain = min(color.rgb, vec3(1.0));
    shown = vec4(dot(sigmas, sigmas) > rim * edge ? min(plain + rim_light, vec3(1.0)) : plain * inside, 1.0);
}
