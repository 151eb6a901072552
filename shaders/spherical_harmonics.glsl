// The real spherical harmonics above the constant, in the order and signs of instdrive_core/maths/spherical_harmonics.py.

uniform sampler2D sh_texture;  // per splat: sh_dc and sh_rest, flattened, padded to whole texels
uniform int sh_texels;
uniform int sh_rest_count;

const float Y0 = 0.28209479177387814;

vec4 sh_texel(int row, int which) {
    return texelFetch(sh_texture, texel_of(row * sh_texels + which), 0);
}

// Colour before clamping, seen along the unit direction camera -> Gaussian (in the splat's own frame). Three texels hold
// four coefficients; each is fetched once.
vec3 sh_color(int row, vec3 direction) {
    vec4 a = sh_texel(row, 0);
    vec3 color = vec3(0.5) + Y0 * a.xyz;
    if (sh_rest_count < 3) {
        return color;
    }
    float x = direction.x, y = direction.y, z = direction.z;
    vec4 b = sh_texel(row, 1), c = sh_texel(row, 2);
    color += 0.4886025119029199 * (-y * vec3(a.w, b.xy) + z * vec3(b.zw, c.x) - x * c.yzw);
    if (sh_rest_count < 8) {
        return color;
    }
    float xx = x * x, yy = y * y, zz = z * z;
    a = sh_texel(row, 3);
    b = sh_texel(row, 4);
    c = sh_texel(row, 5);
    color += 1.0925484305920792 * x * y * a.xyz
        - 1.0925484305920792 * y * z * vec3(a.w, b.xy)
        + 0.31539156525252005 * (2.0 * zz - xx - yy) * vec3(b.zw, c.x)
        - 1.0925484305920792 * x * z * c.yzw;
    a = sh_texel(row, 6);
    color += 0.5462742152960396 * (xx - yy) * a.xyz;
    if (sh_rest_count < 15) {
        return color;
    }
    b = sh_texel(row, 7);
    c = sh_texel(row, 8);
    color += -0.5900435899266435 * y * (3.0 * xx - yy) * vec3(a.w, b.xy)
        + 2.890611442640554 * x * y * z * vec3(b.zw, c.x)
        - 0.4570457994644658 * y * (4.0 * zz - xx - yy) * c.yzw;
    a = sh_texel(row, 9);
    b = sh_texel(row, 10);
    c = sh_texel(row, 11);
    return color + 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * a.xyz
        - 0.4570457994644658 * x * (4.0 * zz - xx - yy) * vec3(a.w, b.xy)
        + 1.445305721320277 * z * (xx - yy) * vec3(b.zw, c.x)
        - 0.5900435899266435 * x * (xx - 3.0 * yy) * c.yzw;
}
