"""How bright and how tinted each photo came out, against the colours of the scene."""

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
    """Of the photos, ``camera_name/NN``; each once."""
    times: Float64[ndarray, " v"]
    """Of the photos, seconds."""
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
        """Exposure of a camera at `time` (seconds): a photo's own at its time, else linear between the camera's
        neighbouring photos, clamped at the ends; the identity for a camera without photos."""
        rows = np.array([row for row, key in enumerate(self.keys) if parse_photo_camera(key) == camera_name], np.int64)
        if not len(rows):
            return create_identity_exposure()
        rows = rows[np.argsort(self.times[rows], kind="stable")]
        times, matrices = self.times[rows], self.matrices[rows].reshape(-1, 12)
        found = [np.interp(time, times, matrices[:, entry]) for entry in range(12)]
        return np.array(found, np.float32).reshape(3, 4)


def parse_photo_camera(key: str) -> str:
    """The camera's name in a photo's key ``camera_name/NN``."""
    return key.rpartition("/")[0]


def create_identity_exposure() -> Float32[ndarray, "3 4"]:
    """The exposure that changes nothing."""
    return np.eye(3, 4, dtype=np.float32)


def apply_exposure(image: Float32[ndarray, "h w 3"], exposure: Float32[ndarray, "3 4"]) -> Float32[ndarray, "h w 3"]:
    """The image as a photo with this exposure shows it; not clamped."""
    return image @ exposure[:, :3].T + exposure[:, 3]
