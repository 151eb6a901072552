"""Scenes as glTF 2.0 with KHR_gaussian_splatting (Khronos, ratified): .glb and .gltf."""
