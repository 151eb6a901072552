"""The shape that drivestudio's deformable things and people have in one frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from numpy import ndarray

from instdrive_core.files.torch_checkpoint import TorchCheckpoint
from instdrive_core.formats.checkpoints.body_skinning import PARENTS, WeightGrid, pose_joints, skin_points
from instdrive_core.formats.checkpoints.deformation import build_bending_network
from instdrive_core.maths.rotations import (
    matrix_from_quaternion,
    multiply_quaternions,
    normalize_quaternions,
    quaternion_from_matrix,
)
from instdrive_core.scene.gaussians import Gaussians

_BENDS_AFTER = 3000
"""Training steps after which drivestudio bends things, unless its settings say otherwise."""
_NETWORK, _TEMPLATE = "deform_network.", "template."
_MOST_WEIGHTS = 1 << 24


@dataclass(frozen=True)
class NodeClass:
    """Instances of one class in a checkpoint, over f frames."""

    file: TorchCheckpoint
    name: str
    state: Mapping[Any, Any]
    owners: Int64[ndarray, " n"]
    """The instance of each row that is kept."""
    present: Bool[ndarray, "f i"]
    rotations: Float[ndarray, "f i 4"]
    translations: Float[ndarray, "f i 3"]
    sizes: Float[ndarray, "i 3"]
    step: int | None
    """Training steps done."""

    def read(self, name: str, *shape: int) -> ndarray:
        """Read a tensor whose last axes have a shape. Raises ValueError where it is missing or not finite."""
        tensor = self.file.find_tensor(self.state.get(name))
        if tensor is None or tensor.shape[len(tensor.shape) - len(shape) :] != shape:
            raise ValueError(f"{name} is missing or has another shape")
        values = tensor.read()
        if not np.isfinite(values).all():
            raise ValueError(f"{name} holds what is no number")
        return values


def bend_deformable(node: NodeClass, part: Gaussians, instance: int, frame: int) -> None:
    """Bend the Gaussians of one instance, in place, as its network says for a frame. Raises ValueError, and why not."""
    if node.step is not None and node.step <= _BENDS_AFTER:
        return
    embeddings = node.read("instances_embedding")
    names = [name for name in node.state if isinstance(name, str) and name.startswith(_NETWORK)]
    tensors = {name.removeprefix(_NETWORK): node.read(name) for name in names}
    if embeddings.ndim != 2 or instance >= len(embeddings):
        raise ValueError("their embeddings are missing")
    network = build_bending_network(tensors, embeddings.shape[1])
    height = float(node.sizes[instance, 2])
    if not height > 0:
        raise ValueError("their height is 0")
    time = frame / max(len(node.present) - 1, 1)
    given = np.broadcast_to(embeddings[instance].astype(np.float32), (len(part), embeddings.shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        offsets = network.compute_offsets((part.means / height * 2).astype(np.float32), time, given)
    if not all(np.isfinite(values).all() for values in offsets.values()):
        raise ValueError("their network gives what is no number")
    part.means += offsets["gaussian_warp"]
    if "gaussian_rotation" in offsets:
        with np.errstate(over="ignore", invalid="ignore"):  # the linter reports what is not finite
            part.quats[:] = normalize_quaternions(normalize_quaternions(part.quats) + offsets["gaussian_rotation"])
    if "gaussian_scaling" in offsets:
        with np.errstate(over="ignore", invalid="ignore"):
            part.log_scales[:] = np.log(np.maximum(np.exp(part.log_scales) + offsets["gaussian_scaling"], 1e-6))


def bend_body(
    node: NodeClass, part: Gaussians, instance: int, frame: int, poses: Float[ndarray, "t 4 4"]
) -> Float64[ndarray, "3"]:
    """Bend the Gaussians of one person, in place, and move the poses to where the body turns.

    Args:
        node: the class.
        part: the person's Gaussians at rest; becomes those in the frame, in the body's own axes.
        instance: the person.
        frame: the frame whose shape is taken.
        poses: world_from_body; changed, as the body turns about its first joint.

    Returns: the middle of the joints in the body's own axes.
    Raises ValueError, and why not; nothing is changed then.
    """
    joints = len(PARENTS)
    try:
        rest = node.read(f"{_TEMPLATE}J_canonical", joints, 3)[instance].astype(np.float64)
        inverse = node.read(f"{_TEMPLATE}A0_inv", joints, 4, 4)[instance].astype(np.float64)
        limbs = node.read("smpl_qauts", joints - 1, 4)[frame, instance].astype(np.float64)
        grid = _read_grid(node, instance)
    except IndexError as error:
        raise ValueError("parts of them are missing") from error
    turns = np.concatenate([np.eye(3)[None], matrix_from_quaternion(normalize_quaternions(limbs))])
    means = part.means.astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        chain = pose_joints(turns, rest)
        transforms = chain @ inverse
        moved, blended = skin_points(means, grid.sample(np.nan_to_num(means, posinf=0, neginf=0)), transforms)
        places = np.einsum("jab,jb->ja", chain[:, :3, :3], rest) + chain[:, :3, 3]
    if not all(np.isfinite(values).all() for values in (moved, blended, places)):
        raise ValueError("their limbs have no finite place")
    part.means[:] = moved
    turned = normalize_quaternions(quaternion_from_matrix(blended))
    with np.errstate(over="ignore", invalid="ignore"):  # the linter reports what is not finite
        part.quats[:] = multiply_quaternions(turned, normalize_quaternions(part.quats))
    # The body turns about its first joint, not about the point that is moved.
    poses[:, :3, 3] += rest[0] - poses[:, :3, :3] @ rest[0]
    return (places.min(axis=0) + places.max(axis=0)) / 2


def _read_grid(node: NodeClass, instance: int) -> WeightGrid:
    prefix = f"{_TEMPLATE}voxel_deformer."
    tensor = node.file.find_tensor(node.state.get(f"{prefix}lbs_voxel_base"))
    if tensor is None or len(tensor.shape) != 5 or tensor.shape[1] != len(PARENTS) or instance >= tensor.shape[0]:
        raise ValueError("the grid of their skinning weights is missing")
    if not 0 < int(np.prod(tensor.shape[1:])) <= _MOST_WEIGHTS:
        raise ValueError("the grid of their skinning weights is empty or too large")
    weights = tensor.read(instance, instance + 1)[0].astype(np.float64)
    correction = node.file.find_tensor(node.state.get(f"{prefix}voxel_w_correction"))
    if correction is not None and correction.shape == tensor.shape:
        weights = weights + correction.read(instance, instance + 1)[0]
    offset = node.read(f"{prefix}offset", 1, 3)[instance].reshape(3).astype(np.float64)
    scale = float(node.read(f"{prefix}scale", 1, 1)[instance].reshape(()))
    ratio = float(node.read(f"{prefix}ratio").reshape(()))
    if not (scale > 0 and ratio > 0 and np.isfinite(weights).all()):
        raise ValueError("the grid of their skinning weights has no size, or holds what is no number")
    return WeightGrid(weights, offset, scale, ratio)
