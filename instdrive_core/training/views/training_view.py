"""One photo for training: image, depths and masks, held in memory in compact form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt16
from numpy import ndarray

from instdrive_core.datasets.clip import Frame
from instdrive_core.masks.label_map_folder import FrameMasks
from instdrive_core.scene.camera import Camera
from instdrive_core.training.views.lidar_depth import Depths, find_nearest_per_pixel
from instdrive_core.training.views.solid_pixels import find_solid_pixels


@dataclass(frozen=True)
class TrainingView:
    """One photo at training resolution."""

    key: str
    camera: Camera
    time: float
    image: UInt8[ndarray, "h w 3"]
    valid: Bool[ndarray, "h w"] | None
    """False on the ego vehicle."""
    labels: UInt16[ndarray, "h w"] | None
    """Instance masks, 0 = none; None where the run has no masks."""
    sky: Bool[ndarray, "h w"] | None
    depth_pixels: Int32[ndarray, " k"]
    """Flat indices of pixels with a known depth."""
    depth_values: Float32[ndarray, " k"]
    """Metres along the optical axis."""
    overlaps: tuple[UInt16[ndarray, "h w"], ...] = ()
    """Further layers of instance masks where masks overlap (`FrameMasks.overlaps`)."""
    measured: bool = True
    """Depths are LiDAR's; else photos agree on them."""

    @property
    def layers(self) -> tuple[UInt16[ndarray, "h w"], ...]:
        """All layers of instance masks; none where the run has no masks."""
        return () if self.labels is None else (self.labels, *self.overlaps)

    @cached_property
    def solid(self) -> Bool[ndarray, "h w"] | None:
        """Pixels in which masks show something before the sky; None where none does, or the sky is unknown."""
        if self.sky is None or not self.layers:
            return None
        solid = find_solid_pixels(self.layers, self.sky, self.camera, self.measured and len(self.depth_pixels) > 0)
        if self.valid is not None:
            solid &= self.valid
        return solid if solid.any() else None

    def halve(self) -> TrainingView:
        """Copy the view at half the resolution, for the coarse part of training."""
        height, width = self.image.shape[0] // 2, self.image.shape[1] // 2
        image = _halve_image(self.image[: height * 2, : width * 2])
        rows, columns = np.divmod(self.depth_pixels, self.image.shape[1])
        inside = (rows < height * 2) & (columns < width * 2)
        pixels = (rows[inside] // 2) * width + columns[inside] // 2
        pixels, depths = find_nearest_per_pixel(pixels, self.depth_values[inside])
        camera = Camera(
            self.camera.fx / 2,
            self.camera.fy / 2,
            self.camera.cx / 2,
            self.camera.cy / 2,
            width,
            height,
            self.camera.world_from_camera,
            self.camera.lag,
        )

        def thin(array: ndarray | None) -> ndarray | None:
            return None if array is None else np.ascontiguousarray(array[: height * 2 : 2, : width * 2 : 2])

        return TrainingView(
            self.key,
            camera,
            self.time,
            image,
            thin(self.valid),
            thin(self.labels),
            thin(self.sky),
            pixels,
            depths,
            tuple(np.ascontiguousarray(layer[: height * 2 : 2, : width * 2 : 2]) for layer in self.overlaps),
            self.measured,
        )


def _halve_image(image: UInt8[ndarray, "h w 3"]) -> UInt8[ndarray, "h//2 w//2 3"]:
    """Average each block of 2×2 pixels, rounded half up; height and width are even."""
    total = image[::2, ::2].astype(np.uint16)
    for corner in (image[::2, 1::2], image[1::2, ::2], image[1::2, 1::2]):
        total += corner
    total += 2
    total >>= 2
    return total.astype(np.uint8)


def build_training_view(frame: Frame, masks: FrameMasks | None, depths: Depths, measured: bool = True) -> TrainingView:
    """Read a frame's photo and join it with its masks (void on the ego car) and its depths, `measured` by LiDAR or not.

    Raises DataError where the photo is damaged.
    """
    layers = (masks.labels, *masks.overlaps) if masks else ()
    if frame.valid is not None:
        layers = tuple(np.where(frame.valid, layer, 0).astype(np.uint16) for layer in layers)
    labels, overlaps = (layers[0], layers[1:]) if layers else (None, ())
    sky, view, image = masks.sky if masks else None, frame.view, frame.load_image()
    return TrainingView(frame.key, view.camera, view.time, image, frame.valid, labels, sky, *depths, overlaps, measured)
