"""How a finished scene trains on. The figures behind the choices are in docs/new_scene.md."""

from __future__ import annotations

from dataclasses import replace

from instdrive_core.datasets.clip import Clip
from instdrive_core.training.settings.clip_size import USUAL_PHOTOS, fit_to_clip
from instdrive_core.training.settings.config import TrainConfig, build_train_config, keep_cameras

_MEANS_RATE = 0.5
"""Rate of the means, as a share of that of a training from nothing: places are known."""
_GROWING_LOOKS = 8
"""How often each photo must be seen before anything grows: what is split needs that long to be better than before."""
_LEAST_ROOM, _MOST_ROOM = 1.15, 1.4
"""A scene grows up to its clip's usual number of Gaussians, but to these multiples of its own number."""
_GROWING_SHARE = 0.4


def build_improving_config(clip: Clip, gaussians: int, iterations: int, seed: int = 0) -> TrainConfig:
    """Build the configuration of a training that goes on from a finished scene.

    Opacities are never reset, and Gaussians grow in the first part only.

    Args:
        clip: what it trains on.
        gaussians: number of Gaussians of the finished scene.
        iterations: steps of one image each.
        seed: of everything random.
    """
    usual = fit_to_clip(build_train_config("instdrive", "quick", seed), clip)
    photos = len(clip.training_frames)
    every = max(1, round(usual.densify.every * photos / USUAL_PHOTOS))
    most = min(max(usual.densify.max_gaussians, round(_LEAST_ROOM * gaussians)), round(_MOST_ROOM * gaussians))
    config = replace(
        usual,
        geometry=replace(
            usual.geometry,
            iterations=iterations,
            coarse_iterations=0,
            means_lr=_MEANS_RATE * usual.geometry.means_lr,
        ),
        densify=replace(
            usual.densify,
            max_gaussians=most if iterations >= _GROWING_LOOKS * photos else 0,
            start=every,
            every=every,
            stop=_GROWING_SHARE,
            reset_every=10 * iterations + 1,
        ),
    )
    return config if clip.training_sweeps else keep_cameras(config)
