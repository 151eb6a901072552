"""Training photos without what moves, where no LiDAR can tell how it moves."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

from instdrive_core.datasets.clip import Clip
from instdrive_core.masks.label_map_folder import MaskFolder
from instdrive_core.scene.seen_moving import SeenMover
from instdrive_core.tracks.choice import TrackSource
from instdrive_core.tracks.photos.seen_movers import find_seen_movers, keep_out_movers, summarize_movers


def set_movers_apart(
    clip: Clip, masks: MaskFolder | None, source: TrackSource | None, on_note: Callable[[str], None]
) -> tuple[Clip, tuple[SeenMover, ...]]:
    """Keep what photos show moving out of training, in clips without LiDAR sweeps; others have tracks for it.

    Args:
        clip: as it trains.
        masks: masks of its training photos; None = there are none, and nothing can be kept out.
        source: where the user wants moving objects taken from; ``none`` leaves everything in.
        on_note: is told what the user should know.

    Raises DataError where a photo or a mask is damaged.
    """
    if clip.training_sweeps or source == "none":
        return clip, ()
    if masks is None:
        on_note("no masks: what moves cannot be kept out of the scene and will blur. Make masks with `instdrive masks`")
        return clip, ()
    if find_spec("cv2") is None:
        on_note("OpenCV is not installed: what moves will blur. Run: pip install 'instdrive[train]'")
        return clip, ()
    found = find_seen_movers(clip, masks)
    if found.movers:
        on_note(f"{summarize_movers(found.movers)}. Moving things are rebuilt where a clip has LiDAR")
    else:
        on_note("nothing is seen moving in the photos")
    return keep_out_movers(clip, found), found.movers
