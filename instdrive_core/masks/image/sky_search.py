"""The sky of a whole clip: first what beams and colours say in a few photos, then each photo."""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Bool, UInt8
from numpy import ndarray

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.masks.image.beams import estimate_beams
from instdrive_core.masks.image.sky import SkyColors, find_certain_sky, find_sky_seeds
from instdrive_core.scene.camera import Camera

ROUNDS = 2
"""The first round takes colours from columns that seem open, the second leaves out those that look like surfaces."""


class SkySearch:
    """Looks for sky seeds in the photos of a clip with LiDAR.

    Args:
        clip: the clip; neither photos nor sweeps of held-out time steps are looked at.
        find_supported: says in which pixels of a photo, (h, w), a surface was met at any time.
    """

    def __init__(self, clip: Clip, find_supported: Callable[[Frame], Bool[ndarray, "h w"]]) -> None:
        self._beams = estimate_beams(clip)
        self._colors: SkyColors | None = None
        for _ in range(ROUNDS):
            colors = SkyColors()
            for frame in _choose_frames(clip):
                image, supported = frame.load_image(), find_supported(frame)
                sky = find_certain_sky(supported, image, frame.view.camera, self._beams, self._colors)
                colors.add(image, sky, supported)
            self._colors = colors

    def find_seeds(
        self, supported: Bool[ndarray, "h w"], image: UInt8[ndarray, "h w 3"], camera: Camera
    ) -> Bool[ndarray, "h w"]:
        """Find pixels of a photo that are sky; see `sky.find_sky_seeds`."""
        assert self._colors is not None
        return find_sky_seeds(supported, image, camera, self._beams, self._colors)


def _choose_frames(clip: Clip) -> list[Frame]:
    """The photos of the first, the middle and the last training step."""
    steps = sorted({frame.view.index for frame in clip.training_frames})
    chosen = {steps[position] for position in (0, len(steps) // 2, -1)} if steps else set()
    return [frame for frame in clip.training_frames if frame.view.index in chosen]
