#version 330
// One quad per projected splat, just large enough to hold every fragment whose alpha reaches `alpha_cut`.
// Image row 0 becomes framebuffer row 0: pictures are read and shown without a flip.

in vec4 splat_center;
in vec4 splat_axes;
in vec3 splat_color;
in uint row;

uniform vec2 viewport;
uniform float alpha_cut;
uniform float min_opacity;
uniform float far;

flat out vec2 center;
flat out vec4 inverse_axes;
flat out vec4 color;
flat out float depth;
flat out uint splat_row;

void main() {
    float opacity = splat_center.w;
    if (opacity <= 0.0 || opacity < min_opacity || opacity < alpha_cut) {
        gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside: clipped away
        center = vec2(0.0);
        inverse_axes = vec4(0.0);
        color = vec4(0.0);
        depth = 0.0;
        splat_row = 0u;
        return;
    }
    vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
    float reach = sqrt(2.0 * log(opacity / alpha_cut)) + 1e-3;
    vec2 pixel = splat_center.xy + reach * (corner.x * splat_axes.xy + corner.y * splat_axes.zw);
    center = splat_center.xy;
    inverse_axes = vec4(
        splat_axes.xy / dot(splat_axes.xy, splat_axes.xy), splat_axes.zw / dot(splat_axes.zw, splat_axes.zw));
    color = vec4(splat_color, opacity);
    depth = splat_center.z;
    splat_row = row;
    gl_Position = vec4(pixel / viewport * 2.0 - 1.0, clamp(depth / far, 0.0, 1.0) * 2.0 - 1.0, 1.0);
}
