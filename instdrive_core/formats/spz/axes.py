"""The axes of an .spz: right, up, back (RUB) unless an extension record says otherwise; those of a .ply are RDF."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.maths.spherical_harmonics import evaluate_rest_basis
from instdrive_core.scene.gaussians import Gaussians

COORDINATE_SYSTEM = 0xADBE0003
"""Type of the extension record that names the axes (SPZ_ADOBE_coordinate_system)."""
RUB = 4
"""What a .spz has unless it says otherwise."""
RDF = 6
"""A .ply's, so that nothing is flipped."""
_REMEDY = "Export it again without extensions"


@dataclass(frozen=True)
class AxisFlips:
    """Factors ±1 that turn values of one system into the other's; the same ones turn them back."""

    means: Float32[ndarray, "3"]
    quats: Float32[ndarray, "4"]
    sh_rest: Float32[ndarray, "15 1"]

    def apply(self, gaussians: Gaussians) -> None:
        """Flip in place."""
        with np.errstate(invalid="ignore"):  # version 1 can hold numbers that are none
            gaussians.means *= self.means
        gaussians.quats *= self.quats
        gaussians.sh_rest *= self.sh_rest[: gaussians.sh_rest.shape[1]]


def find_flips(system: int) -> AxisFlips:
    """Find the flips from a system 1 … 8 (bits of `system` - 1: x right, y up, z forward) to right, down, forward."""
    bits = system - 1
    signs = np.array([1 if bits & 1 else -1, -1 if bits & 2 else 1, 1 if bits & 4 else -1], np.float32)
    x, y, z = signs
    direction = np.array([[0.3, 0.5, 0.8]], np.float32)
    parity = np.sign(evaluate_rest_basis(direction * signs, 15) * evaluate_rest_basis(direction, 15)).astype(np.float32)
    return AxisFlips(signs, np.array([1, y * z, x * z, x * y], np.float32), parity.T)


def parse_axes(records: bytes, path: Path) -> int:
    """Parse the system that extension records name, RUB where none does. Raises DataError."""
    start, system = 0, RUB
    while start < len(records):
        kind = int.from_bytes(records[start : start + 4], "little")
        length = int.from_bytes(records[start + 4 : start + 8], "little")
        payload = records[start + 8 : start + 8 + length]
        if start + 8 > len(records) or len(payload) < length:
            problem = f"the extension record at byte {start} of its block promises {length} bytes and is cut off"
            raise DataError(path, problem, _REMEDY)
        if kind == COORDINATE_SYSTEM:
            system = int.from_bytes(payload, "little") or RUB
        start += 8 + length
    if not 1 <= system <= 8:
        raise DataError(path, f"its coordinate system {system} is none of 1 to 8, which can be read", _REMEDY)
    return system
