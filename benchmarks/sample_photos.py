"""Photos for a scene that comes without them: what its cameras see."""

from __future__ import annotations

import json
from pathlib import Path

from PIL import Image

from instdrive_core.formats.registry import open_scene
from instdrive_core.rasterize.pictures import draw_picture


def add_photos(scene: Path, count: int) -> None:
    """Give the first cameras of a scene folder a photo each, so that there is something to compare with."""
    opened, manifest = open_scene(scene), json.loads((scene / "scene.json").read_text(encoding="utf-8"))
    for number, view in enumerate(opened.views[:count]):
        name = f"photo_{number}.png"
        Image.fromarray(draw_picture(opened, view.camera, view.time, "color")).save(scene / name)
        manifest["views"][number]["photo"] = name
    (scene / "scene.json").write_text(json.dumps(manifest), encoding="utf-8")
