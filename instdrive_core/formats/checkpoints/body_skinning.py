"""How drivestudio's people bend: linear blend skinning of SMPL's 24 joints, from what the checkpoint holds.

Rest joints, inverse rest transforms and the grid of skinning weights are buffers of the checkpoint; SMPL's model file
is not needed. (Loper et al. 2015, "SMPL"; the grid of weights: Chen et al. 2022, "Fast-SNARF".)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
"""The joint that each of SMPL's joints hangs on."""


@dataclass(frozen=True)
class WeightGrid:
    """Skinning weights at the points of a grid around a person at rest."""

    weights: Float[ndarray, "24 d h w"]
    offset: Float[ndarray, "3"]
    """Middle of the grid, metres."""
    scale: float
    """Half its width and height, metres."""
    ratio: float
    """How many times flatter it is in z."""

    def sample(self, points: Float[ndarray, "n 3"]) -> Float[ndarray, "n 24"]:
        """Sample between grid points, and at the border beyond it."""
        places = (points - self.offset) / self.scale
        places[:, 2] *= self.ratio
        joints, *sizes = self.weights.shape
        flat = self.weights.reshape(joints, -1)
        limits = np.array(sizes[::-1]) - 1
        places = np.clip((places + 1) / 2 * limits, 0, limits)
        lower = np.minimum(places.astype(np.int64), np.maximum(limits - 1, 0))
        part = places - lower
        result = np.zeros((len(points), joints))
        for corner in np.ndindex(2, 2, 2):
            x, y, z = np.minimum(lower + corner, limits).T
            share = np.where(corner, part, 1 - part).prod(axis=1)
            result += flat[:, (z * sizes[1] + y) * sizes[2] + x].T * share[:, None]
        return result


def pose_joints(rotations: Float[ndarray, "24 3 3"], joints: Float[ndarray, "24 3"]) -> Float[ndarray, "24 4 4"]:
    """Compute where each joint's transform takes points of a body with straight limbs.

    Args:
        rotations: of each joint against its parent; the first one is the body's own.
        joints: of that body, metres.
    """
    chain = np.empty((len(PARENTS), 4, 4))
    for joint, parent in enumerate(PARENTS):
        step = np.eye(4)
        step[:3, :3] = rotations[joint]
        step[:3, 3] = joints[joint] - (joints[parent] if parent >= 0 else 0)
        chain[joint] = step if parent < 0 else chain[parent] @ step
    # Transforms act on points, so the joint's own place in that body is taken off first.
    chain[:, :3, 3] -= np.einsum("jab,jb->ja", chain[:, :3, :3], joints)
    return chain


def skin_points(
    points: Float[ndarray, "n 3"], weights: Float[ndarray, "n 24"], transforms: Float[ndarray, "24 4 4"]
) -> tuple[Float[ndarray, "n 3"], Float[ndarray, "n 3 3"]]:
    """Blend the joints' transforms: where the points go, and how what is at them turns (not quite orthonormal)."""
    blended = np.einsum("nj,jab->nab", weights, transforms)
    turns = blended[:, :3, :3]
    return np.einsum("nab,nb->na", turns, points) + blended[:, :3, 3], turns
