#version 330
// The sky's cube map along the pixel's ray, in the face layout of instdrive_core/scene/sky.py; alpha stays 0.

uniform sampler2DArray faces;
uniform mat3 world_from_camera;
uniform vec2 focal;
uniform vec2 principal;

out vec4 premultiplied;

void main() {
    vec3 ray = world_from_camera * vec3((gl_FragCoord.xy - principal) / focal, 1.0);
    vec3 size = abs(ray);
    int axis = size.x >= size.y && size.x >= size.z ? 0 : (size.y >= size.z ? 1 : 2);
    float major = ray[axis];
    vec2 place = vec2(ray[(axis + 1) % 3], ray[(axis + 2) % 3]) * (0.5 / abs(major)) + 0.5;
    premultiplied = vec4(texture(faces, vec3(place, float(axis * 2 + (major < 0.0 ? 1 : 0)))).rgb, 0.0);
}
