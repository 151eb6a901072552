// The alpha of a splat at this fragment: opacity times the Gaussian of the distance in sigmas.

flat in vec2 center;
flat in vec4 inverse_axes;
flat in vec4 color;
flat in float depth;
flat in uint splat_row;

uniform float max_alpha;

float fragment_alpha() {
    vec2 offset = gl_FragCoord.xy - center;
    vec2 sigmas = vec2(dot(inverse_axes.xy, offset), dot(inverse_axes.zw, offset));
    return min(max_alpha, color.a * exp(-0.5 * dot(sigmas, sigmas)));
}
