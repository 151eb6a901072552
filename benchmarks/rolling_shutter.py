"""``python -m benchmarks.rolling_shutter RUN``: a drawn shutter against a street ray-traced row by row. One JSON line.

`psnr_rolling` is that of pictures with the shutter against photos with it, `psnr_at_once` that of pictures without it
against the same photos, `psnr_bound` that of pictures without it against photos without it: what the scene reaches.
"""

from __future__ import annotations

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.sensors.raytrace import RayScene
from instdrive_core.datasets.synthetic.sensors.render import EXPOSURE, StepRenderer
from instdrive_core.datasets.synthetic.sensors.rolling_shutter import Exposure, photograph_rows
from instdrive_core.datasets.synthetic.units import StreetUnits
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.metrics.image_metrics import psnr
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts
from instdrive_core.formats.registry import open_scene
from instdrive_core.rasterize.rolling_shutter import view_through_shutter
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.recording.shutter import Shutter, build_rolling_rig
from instdrive_core.scene.camera import Camera


@dataclass(frozen=True)
class Options:
    """What is compared."""

    run: tyro.conf.Positional[Path]
    """A run trained on a synthetic clip."""
    seconds: float = 0.05
    """From a picture's first to its last row."""
    views: int = 12


def measure_rolling_shutter(options: Options) -> dict[str, Any]:
    """Everything the JSON line says."""
    scene, facts = open_scene(options.run), read_run_facts(options.run)
    clip = load_clip(facts["clip"], build_clip_options(facts))
    street = StreetUnits(clip.path).street
    rig = build_rolling_rig(Shutter(options.seconds), scene.views)
    chosen = np.linspace(len(rig.ways), len(scene.views) - 1 - len(rig.ways), options.views).round().astype(int)
    standing, found = RayScene(street.standing.mesh.corners), []
    street_from_world = np.linalg.inv(street.world_from_street())

    def move(camera: Camera, pose: Float64[ndarray, "4 4"]) -> Camera:
        moved = pose.copy()
        moved[:3, 3] += scene.origin
        return replace(camera, world_from_camera=street_from_world @ moved)

    with ThreadPoolExecutor(1) as pool:
        for view in [scene.views[place] for place in chosen]:
            way, camera = rig.ways[view.name], view.camera

            def place(moment: float, way: Any = way, camera: Camera = camera) -> Camera:
                return move(camera, way.find_pose(moment))

            (rolled,) = photograph_rows(street, standing, [Exposure(place, EXPOSURE)], view.time, options.seconds, pool)
            still = StepRenderer(street.geometry(view.time), street.materials, street.light).photograph(
                move(camera, camera.world_from_camera)
            )
            drawn = view_scene(scene, camera, view.time).color
            skewed = view_through_shutter(scene, rig.roll(view)).color
            pairs = (skewed, rolled.image), (drawn, rolled.image), (drawn, still.image)
            everywhere = np.ones(drawn.shape[:2], bool)
            found.append([psnr(np.clip(mine, 0, 1), true / np.float32(255), everywhere) for mine, true in pairs])
    rolling, at_once, bound = np.mean(np.array(found, float), axis=0).round(2).tolist()
    return {
        "seconds": options.seconds,
        "views": len(found),
        "psnr_rolling": rolling,
        "psnr_at_once": at_once,
        "psnr_bound": bound,
    }


if __name__ == "__main__":
    try:
        print(json.dumps(measure_rolling_shutter(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
