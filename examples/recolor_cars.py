"""Repaint every car, keeping light and shade, and draw the scene before and after."""

from __future__ import annotations

import colorsys

import numpy as np
from PIL import Image
from scene_and_folder import scene_and_folder

from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import save_scene
from instdrive_core.project.open import open_document
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.scene import Scene


def picture(scene: Scene) -> Image.Image:
    """The scene through its first camera."""
    view = scene.views[0]
    frame = view_scene(scene, view.camera, view.time)
    return Image.fromarray((frame.color.clip(0, 1) * 255).astype(np.uint8))


path, folder = scene_and_folder()
document, _ = open_document(path)
picture(document.scene).save(folder / "before.png")

cars = [instance.id for instance in document.scene.table if instance.class_name == "Car"]
for number, car in enumerate(cars):
    color = colorsys.hsv_to_rgb(number / len(cars), 0.8, 0.7)
    document.apply(RecolorInstances((car,), "tint", color))

result = bake_document(document)
picture(result).save(folder / "after.png")
save_scene(folder / "recolored", result)
print(f"{len(cars)} cars repainted: {folder}/before.png, after.png and the scene folder recolored/")
