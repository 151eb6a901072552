"""The two glTF formats as records."""

from __future__ import annotations

from instdrive_core.formats.gltf.scenes import read_gltf
from instdrive_core.formats.gltf.writing import write_glb, write_gltf
from instdrive_core.formats.instance_parts import order_by_instance
from instdrive_core.formats.scene_format import Fidelity, Format

_FIDELITY = Fidelity(order_scene=order_by_instance)
GLB = Format("glTF, binary (KHR_gaussian_splatting)", ".glb", read_gltf, write_glb, _FIDELITY, up="+z")
GLTF = Format("glTF (KHR_gaussian_splatting)", ".gltf", read_gltf, write_gltf, _FIDELITY, up="+z")
