"""Maps of the instance that each pixel of a photo's camera shows, drawn from a scene, for exports."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from jaxtyping import UInt32
from numpy import ndarray

from instdrive_core.errors import OptionError
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene

MAX_SIDE = 16384


@dataclass(frozen=True)
class IdMap:
    """One view's instances."""

    view: CameraView
    """View as the scene keeps it; its camera has the scale of training."""
    ids: UInt32[ndarray, "h w"]
    """0 = none."""


def choose_views(scene: Scene, camera: str | None = None, every: int = 1) -> tuple[CameraView, ...]:
    """Choose the scene's views of one camera or of all, of every so many time steps, the first included.

    Raises OptionError where that leaves nothing, or names cannot be used as files.
    """
    if every < 1:
        raise OptionError(f"every {every}th time step cannot be chosen; give a whole number from 1")
    if not scene.views:
        raise OptionError("the scene keeps no photo cameras, so it has no views; open the run folder that it came from")
    names = list(dict.fromkeys(view.name for view in scene.views))
    if camera is not None and camera not in names:
        raise OptionError(f"the scene has no camera {camera!r}; it has {', '.join(names)}")
    unusable = [name for name in names if name in ("", ".", "..") or any(sign in name for sign in '/\\:\0"<>|?*')]
    if unusable:
        raise OptionError(f"a camera of the scene is called {unusable[0]!r}, which cannot be a folder's name")
    steps = sorted({view.index for view in scene.views if camera in (None, view.name)})[::every]
    return tuple(view for view in scene.views if camera in (None, view.name) and view.index in steps)


def render_id_maps(scene: Scene, views: Sequence[CameraView], scale: float = 1.0) -> Iterator[IdMap]:
    """Render the map of each view at its own time, at `scale` times its size.

    Raises OptionError for a scale that makes pictures of no, or too many, pixels.
    """
    largest = max((max(view.camera.width, view.camera.height) for view in views), default=1)
    if not (math.isfinite(scale) and scale > 0 and largest * scale <= MAX_SIDE):
        raise OptionError(
            f"the scale is {scale:g}; pictures of {largest} pixels can be scaled by up to {MAX_SIDE / largest:g}"
        )
    for view in views:
        yield IdMap(view, build_instance_map(scene, view_scene(scene, view.camera.scale(scale), view.time)))
