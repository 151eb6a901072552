#version 330
// One splat per vertex, in drawing order: EWA projection and view-dependent colour, captured by transform feedback,
// so that the colour, depth and ID passes share one projection (Zwicker et al. 2001; Kerbl et al. 2023).

#include "fetch.glsl"
#include "spherical_harmonics.glsl"

in uint row;

uniform sampler2D geometry_texture;  // 3 texels: mean and opacity; unit quaternion wxyz; scales
uniform usampler2D node_texture;
uniform usampler2D color_entry_texture;
uniform usampler2D transform_entry_texture;
uniform usampler2D state_texture;     // edit flags
uniform sampler2D pose_texture;       // 4 texels a node: rows of world_from_node (3x4); presence
uniform sampler2D color_texture;      // 4 texels an entry: rows of the colour map (3x4); alpha
uniform sampler2D transform_texture;  // 4 texels an entry: rows of [R | t] (3x4); scale

uniform int row_count;  // an order that is older than the scene may name rows that are gone

uniform mat4 camera_from_world;
uniform vec3 camera_position;
uniform vec2 focal;
uniform vec2 principal;
uniform vec2 viewport;
uniform vec4 slope_limits;  // x / z and y / z beyond which the Jacobian is held: min x, max x, min y, max y
uniform float near;
uniform float low_pass;
uniform float alpha_cut;
uniform bool antialiased;
uniform uint hidden_flags;
uniform bool dots;          // every splat a dot at its centre, alike in size and opacity
uniform float least_dot;    // opacity that a splat needs to be one
uniform float dot_opacity;

out vec4 splat_center;  // pixel x, y; depth; opacity (0 = not drawn)
out vec4 splat_axes;    // the one-sigma half axes of the ellipse, in pixels
out vec3 splat_color;

mat3 rotation_of(vec4 quat) {  // unit, wxyz
    float w = quat.x, x = quat.y, y = quat.z, z = quat.w;
    return mat3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

// A rigid frame [R | t] from the three texels that hold its rows.
mat4x3 frame_of(sampler2D frames, int first) {
    return transpose(mat3x4(
        texelFetch(frames, texel_of(first), 0),
        texelFetch(frames, texel_of(first + 1), 0),
        texelFetch(frames, texel_of(first + 2), 0)));
}

// Image covariance xx, xy, yy with the low-pass added, and its determinant; `sharp` is the one without. `half_map` =
// view rotation · world rotation · scale. Determinants as |U0 x U1|² have no cancellation, which makes thin splats
// singular in float32.
vec4 image_covariance(vec3 local, mat3 half_map, out float sharp) {
    vec2 slope = clamp(local.xy / local.z, slope_limits.xz, slope_limits.yw);
    vec3 jacobian_x = vec3(focal.x, 0.0, -focal.x * slope.x) / local.z;
    vec3 jacobian_y = vec3(0.0, focal.y, -focal.y * slope.y) / local.z;
    vec3 u0 = jacobian_x * half_map;
    vec3 u1 = jacobian_y * half_map;
    float xx = dot(u0, u0), yy = dot(u1, u1);
    vec3 across = cross(u0, u1);
    sharp = dot(across, across);
    float determinant = sharp + low_pass * (xx + yy + low_pass);
    return vec4(xx + low_pass, dot(u0, u1), yy + low_pass, determinant);
}

vec4 half_axes(vec4 covariance) {
    float mid = 0.5 * (covariance.x + covariance.z);
    float half_gap = 0.5 * (covariance.x - covariance.z);
    float radius = sqrt(half_gap * half_gap + covariance.y * covariance.y);
    float major = mid + radius;
    float minor = covariance.w / major;
    vec2 direction = half_gap >= 0.0 ? vec2(half_gap + radius, covariance.y) : vec2(covariance.y, radius - half_gap);
    direction = dot(direction, direction) > 0.0 ? normalize(direction) : vec2(1.0, 0.0);
    return vec4(sqrt(major) * direction, sqrt(minor) * vec2(-direction.y, direction.x));
}

void main() {
    splat_center = vec4(0.0);
    splat_axes = vec4(0.0);
    splat_color = vec3(0.0);
    int index = int(row);
    if (index >= row_count) {
        return;
    }
    uint flags = texelFetch(state_texture, texel_of(index), 0).r;
    int node = int(texelFetch(node_texture, texel_of(index), 0).r) * 4;
    if ((flags & hidden_flags) != 0u || texelFetch(pose_texture, texel_of(node + 3), 0).r == 0.0) {
        return;
    }
    vec4 mean = texelFetch(geometry_texture, texel_of(index * 3), 0);
    int entry = int(texelFetch(color_entry_texture, texel_of(index), 0).r) * 4;
    float opacity = mean.w * texelFetch(color_texture, texel_of(entry + 3), 0).r;
    if (opacity < alpha_cut || (dots && opacity < least_dot)) {
        return;
    }
    opacity = dots ? dot_opacity : opacity;

    // First the move, within the node's frame, then the node's pose.
    int move = int(texelFetch(transform_entry_texture, texel_of(index), 0).r) * 4;
    mat4x3 node_from_row = frame_of(transform_texture, move);
    float size = texelFetch(transform_texture, texel_of(move + 3), 0).r;
    mat4x3 world_from_node = frame_of(pose_texture, node);
    vec3 position = world_from_node * vec4(mat3(node_from_row) * (size * mean.xyz) + node_from_row[3], 1.0);
    vec3 local = (camera_from_world * vec4(position, 1.0)).xyz;
    if (!(local.z > near)) {
        return;
    }

    mat3 rotation = mat3(world_from_node) * mat3(node_from_row);
    mat3 turn = mat3(camera_from_world) * rotation * rotation_of(texelFetch(geometry_texture, texel_of(index * 3 + 1), 0));
    vec3 scale = dots ? vec3(0.0) : size * texelFetch(geometry_texture, texel_of(index * 3 + 2), 0).xyz;
    mat3 half_map = mat3(turn[0] * scale.x, turn[1] * scale.y, turn[2] * scale.z);
    float sharp;
    vec4 covariance = image_covariance(local, half_map, sharp);
    vec2 pixel = focal * local.xy / local.z + principal;
    if (antialiased) {
        opacity *= sqrt(sharp / covariance.w);
        if (opacity < alpha_cut) {
            return;
        }
    }
    float reach = sqrt(2.0 * log(opacity / alpha_cut));
    vec2 extent = reach * sqrt(covariance.xz);
    if (any(lessThanEqual(pixel + extent, vec2(0.5))) || any(greaterThanEqual(pixel - extent, viewport - 0.5))) {
        return;
    }

    // What is turned shows along d what it showed along the direction turned back.
    vec3 direction = normalize(transpose(rotation) * (position - camera_position));
    vec4 color = vec4(sh_color(index, direction), 1.0);
    vec3 recolored = vec3(
        dot(texelFetch(color_texture, texel_of(entry), 0), color),
        dot(texelFetch(color_texture, texel_of(entry + 1), 0), color),
        dot(texelFetch(color_texture, texel_of(entry + 2), 0), color));
    splat_center = vec4(pixel, local.z, opacity);
    splat_axes = half_axes(covariance);
    splat_color = max(recolored, vec3(0.0));
}
