"""Make the sample scene that comes with the editor from a trained run: `python -m benchmarks.sample_scene RUN`.

To stay below 5 MB the Gaussians that its photos show least of, view-dependent colour and features are dropped, and
arrays stored in half precision.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro
from jaxtyping import Float32, Float64
from numpy import ndarray
from tyro.conf import Positional, arg

from instdrive_core.edits.queries.bake import recount_table
from instdrive_core.formats.folder.scenes import read_scene_folder, write_scene_folder
from instdrive_core.rasterize.kernels.blend_weights import compute_blend_weights
from instdrive_core.scene.scene import Scene, place_in_world
from instdrive_core.scene.sky import Sky

COUNT = 104_000
"""Gaussians that fit."""
CAMERAS = ("front_camera", "front_left_camera", "front_right_camera", "back_camera")


def reduce_scene(scene: Scene) -> Scene:
    """What a newcomer needs: visible Gaussians with one colour each, instances, actors, sky, some cameras."""
    shown = weight_shown(scene)
    least = np.sort(shown)[-min(COUNT, len(scene))]
    kept = np.flatnonzero((shown >= least) & (shown > 0))
    gaussians = scene.gaussians.select(kept)
    gaussians.sh_rest, gaussians.features = gaussians.sh_rest[:, :0], gaussians.features[:, :0]
    views = tuple(replace(view, photo="") for view in scene.views if view.name in CAMERAS)
    smaller = replace(
        scene,
        gaussians=gaussians,
        instance_ids=scene.instance_ids[kept],
        codewords=scene.codewords[kept],
        nodes=scene.nodes[kept],
        sky=Sky(halve_tracks(scene.sky.faces)) if scene.sky else None,
        views=views,
    )
    return recount_table(smaller)


def weight_shown(scene: Scene) -> Float64[ndarray, " n"]:
    """How much each Gaussian carries of all photos' pixels."""
    gaussians, total = scene.gaussians, np.zeros(len(scene))
    for view in scene.views:
        poses, present = scene.find_node_poses(view.time)
        means, quats = place_in_world(gaussians.means, gaussians.quats, scene.nodes, poses)
        opacities = np.where(present[scene.nodes] > 0, gaussians.opacities, np.float32(0))
        pixels = np.arange(view.camera.width * view.camera.height)
        weights = compute_blend_weights(means, quats, gaussians.log_scales, opacities, view.camera, pixels)
        total += np.bincount(weights.rows, weights.weights, len(scene))
    return total


def halve_tracks(faces: Float32[ndarray, "6 r r 3"]) -> Float32[ndarray, "6 h h 3"]:
    """Cube faces at half the resolution."""
    half = faces.shape[1] // 2
    return faces[:, : half * 2, : half * 2].reshape(6, half, 2, half, 2, 3).mean(axis=(2, 4))


def main(
    run: Positional[Path] = Path("runs/demo/run"),
    out: Annotated[Path, arg(aliases=["-o"])] = Path("assets/sample_scene"),
) -> None:
    """Write a run's reduced scene.

    Args:
        run: Folder of a finished run.
        out: Folder of the sample scene.
    """
    scene = reduce_scene(read_scene_folder(run))
    write_scene_folder(out, scene, half=True)
    size = sum(file.stat().st_size for file in out.iterdir())
    facts = {"gaussians": len(scene), "instances": len(scene.table), "megabytes": round(size / 1e6, 2)}
    print(json.dumps({"scene": str(out), **facts}))


if __name__ == "__main__":
    tyro.cli(main)
