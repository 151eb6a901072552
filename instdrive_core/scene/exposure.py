"""Brightness and tint of each photo, compared with the colours of the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Float64
from numpy import ndarray


@dataclass(frozen=True)
class Exposures:
    """An affine change of colour per photo: a photo shows matrix[:, :3] · colour + matrix[:, 3].

    Raises ValueError where the parts do not fit together or hold no finite numbers.
    """

    keys: tuple[str, ...]
    """Keys of the photos, ``camera_name/NN``; each once."""
    times: Float64[ndarray, " v"]
    """Times of the photos, seconds."""
    matrices: Float32[ndarray, "v 3 4"]

    def __post_init__(self) -> None:
        count = len(self.keys)
        if self.times.shape != (count,) or self.matrices.shape != (count, 3, 4):
            raise ValueError(
                f"exposures of {count} photos have {self.times.shape} times and {self.matrices.shape} matrices"
            )
        if len(set(self.keys)) != count:
            raise ValueError("exposures name a photo twice")
        for key, time, matrix in zip(self.keys, self.times, self.matrices, strict=True):
            if not (np.isfinite(time) and np.isfinite(matrix).all()):
                raise ValueError(f"the exposure of photo {key} is not finite")

    def interpolate(self, camera_name: str, time: float) -> Float32[ndarray, "3 4"]:
        """Interpolate a camera's exposure at `time` (seconds), linearly between its photos and clamped at the ends.

        A camera without photos has the identity.
        """
        rows = np.array([row for row, key in enumerate(self.keys) if parse_photo_camera(key) == camera_name], np.int64)
        if not len(rows):
            return create_identity_exposure()
        rows = rows[np.argsort(self.times[rows], kind="stable")]
        times, matrices = self.times[rows], self.matrices[rows].reshape(-1, 12)
        found = [np.interp(time, times, matrices[:, entry]) for entry in range(12)]
        return np.array(found, np.float32).reshape(3, 4)


def parse_photo_camera(key: str) -> str:
    """Parse the camera's name in a photo's key ``camera_name/NN``."""
    return key.rpartition("/")[0]


def create_identity_exposure() -> Float32[ndarray, "3 4"]:
    """Create the exposure that changes nothing."""
    return np.eye(3, 4, dtype=np.float32)


def apply_exposure(image: Float32[ndarray, "h w 3"], exposure: Float32[ndarray, "3 4"]) -> Float32[ndarray, "h w 3"]:
    """Change an image's colours to those of a photo with this exposure; not clamped."""
    return image @ exposure[:, :3].T + exposure[:, 3]
