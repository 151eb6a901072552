"""What a training step needs of one photo: image, LiDAR depth, masks, held in memory in compact form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt16
from numpy import ndarray

from instdrive_core.datasets.clip import Frame
from instdrive_core.scene.camera import Camera

MAX_LIDAR_DEPTH = 80.0
"""Metres; farther returns are too sparse to supervise depth."""


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
    """Flat indices of pixels with a LiDAR depth."""
    depth_values: Float32[ndarray, " k"]
    """Metres along the optical axis."""

    def depth_map(self) -> Float32[ndarray, "h w"]:
        """LiDAR depth per pixel, 0 = unknown."""
        depth = np.zeros(self.image.shape[:2], np.float32)
        depth.ravel()[self.depth_pixels] = self.depth_values
        return depth

    def halved(self) -> TrainingView:
        """The same view at half the resolution, for the coarse part of training."""
        height, width = self.image.shape[0] // 2, self.image.shape[1] // 2
        cropped = self.image[: height * 2, : width * 2].reshape(height, 2, width, 2, 3).astype(np.uint16)
        image = ((cropped.sum(axis=(1, 3)) + 2) // 4).astype(np.uint8)
        rows, columns = np.divmod(self.depth_pixels, self.image.shape[1])
        inside = (rows < height * 2) & (columns < width * 2)
        pixels = (rows[inside] // 2) * width + columns[inside] // 2
        pixels, depths = nearest_per_pixel(pixels, self.depth_values[inside])
        camera = Camera(
            self.camera.fx / 2,
            self.camera.fy / 2,
            self.camera.cx / 2,
            self.camera.cy / 2,
            width,
            height,
            self.camera.world_from_camera,
        )

        def thinned(array: ndarray | None) -> ndarray | None:
            return None if array is None else np.ascontiguousarray(array[: height * 2 : 2, : width * 2 : 2])

        return TrainingView(
            self.key,
            camera,
            self.time,
            image,
            thinned(self.valid),
            thinned(self.labels),
            thinned(self.sky),
            pixels,
            depths,
        )


def nearest_per_pixel(
    pixels: Int32[ndarray, " n"], depths: Float32[ndarray, " n"]
) -> tuple[Int32[ndarray, " k"], Float32[ndarray, " k"]]:
    """The smallest depth of each pixel that occurs; pixels come out sorted."""
    order = np.lexsort((depths, pixels))
    pixels, first = np.unique(pixels[order], return_index=True)
    return pixels.astype(np.int32), depths[order][first].astype(np.float32)


def projected_depths(
    points: Float32[ndarray, "n 3"], camera: Camera
) -> tuple[Int32[ndarray, " k"], Float32[ndarray, " k"]]:
    """Nearest LiDAR depth per pixel that a point falls on, at most `MAX_LIDAR_DEPTH`."""
    pixels, depths = camera.project(points)
    columns, rows = np.floor(pixels[:, 0]), np.floor(pixels[:, 1])
    seen = (depths > 0.5) & (depths < MAX_LIDAR_DEPTH)
    seen &= (columns >= 0) & (columns < camera.width) & (rows >= 0) & (rows < camera.height)
    flat = (rows[seen] * camera.width + columns[seen]).astype(np.int32)
    return nearest_per_pixel(flat, depths[seen].astype(np.float32))


def training_view(
    frame: Frame,
    points: Float32[ndarray, "n 3"],
    labels: UInt16[ndarray, "h w"] | None,
    sky: Bool[ndarray, "h w"] | None,
) -> TrainingView:
    """Read a frame's photo and join it with the LiDAR points of its time step and its masks (void on the ego car)."""
    if labels is not None and frame.valid is not None:
        labels = np.where(frame.valid, labels, 0).astype(np.uint16)
    pixels, depths = projected_depths(points, frame.view.camera)
    if frame.valid is not None:
        on_scene = frame.valid.ravel()[pixels]
        pixels, depths = pixels[on_scene], depths[on_scene]
    return TrainingView(
        frame.key, frame.view.camera, frame.view.time, frame.load_image(), frame.valid, labels, sky, pixels, depths
    )
