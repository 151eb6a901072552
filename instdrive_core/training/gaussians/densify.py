"""Growing and pruning of Gaussians between steps: 3DGS (sec. 5.2) as gsplat's default strategy runs it, with AbsGS.

Gaussians whose mean screen-space gradient is large grow: small ones are cloned, large ones split in two. Faint ones go,
after a reset of the opacities oversized ones too. Differences from gsplat: there is a cap, under which those with the
largest gradients grow first; sizes on an actor are judged by its box, as in Street Gaussians; and gradients seen while
the scene recovers from a reset, dark as it is, count for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Float64, Int64, UInt16
from numpy import ndarray
from torch import Tensor

from instdrive_core.scene.track import Track
from instdrive_core.training.backends.backend import SeenSplats
from instdrive_core.training.gaussians.visible_adam import VisibleAdam
from instdrive_core.training.settings.config import DensifyConfig

_SPLIT_SHRINKS = 1.6
"""Both halves of a split Gaussian are smaller by this factor (3DGS)."""
_RECOVERY = 5
"""Refinements left out after a reset: with Adam's step of 0.05 an opacity needs some hundred views to come back."""


@dataclass
class GrowthStatistics:
    """Screen-space gradients of each Gaussian since the last refinement."""

    gradient_sums: Float[Tensor, " n"]
    """Over the views that saw it: `SeenSplats.gradients`."""
    view_counts: Float[Tensor, " n"]
    """How many views saw it."""

    @staticmethod
    def empty(count: int, device: torch.device) -> GrowthStatistics:
        """Start the statistics of `count` Gaussians that no view has seen."""
        return GrowthStatistics(torch.zeros(count, device=device), torch.zeros(count, device=device))

    def __len__(self) -> int:
        return len(self.gradient_sums)

    @torch.no_grad()
    def add(self, rows: Int64[Tensor, " v"] | Int64[ndarray, " v"], seen: SeenSplats) -> None:
        """Count one view; `seen` has an entry for each of the (distinct) `rows`."""
        visible, gradients = seen.visible, seen.gradients
        if visible is None or gradients is None:
            raise ValueError("the backward pass has not filled what was seen")
        places = torch.as_tensor(rows, device=self.gradient_sums.device)
        self.gradient_sums.index_add_(0, places, gradients.where(visible, 0))
        self.view_counts.index_add_(0, places, visible.float())

    def mean_gradients(self) -> Float[Tensor, " n"]:
        """Over the views that saw each Gaussian; 0 for those never seen."""
        return self.gradient_sums / self.view_counts.clamp(min=1)

    def rearrange(self, parents: Int64[ndarray, " m"]) -> GrowthStatistics:
        """The statistics after a refinement: they start anew for everyone."""
        return GrowthStatistics.empty(len(parents), self.gradient_sums.device)

    def state_tensors(self) -> dict[str, Tensor]:
        """Tensors that a checkpoint keeps, by name; not copied."""
        return dict(vars(self))

    def load_state_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Take over what `state_tensors` gave, by value. Raises ValueError where a tensor is missing or misfits."""
        for name, mine in self.state_tensors().items():
            if name not in tensors or tensors[name].shape != mine.shape:
                found = tuple(tensors[name].shape) if name in tensors else "nothing"
                raise ValueError(f"growth statistics {name}: expected shape {tuple(mine.shape)}, found {found}")
            mine.copy_(tensors[name])


@dataclass(frozen=True)
class DensifyResult:
    """The Gaussians after growing and pruning."""

    parameters: dict[str, Tensor]
    nodes: UInt16[ndarray, " m"]
    """Rising: background first, then actor by actor."""
    parents: Int64[ndarray, " m"]
    """The row that each row was, or came from."""
    fresh: Bool[ndarray, " m"]
    """New rows, whose Adam moments start at zero: clones (the original stays as it was) and both halves of a split."""
    cloned: int
    split: int
    pruned: int
    """There are now cloned + split - pruned more than before."""


def compute_actor_radii(tracks: Sequence[Track]) -> Float64[ndarray, " k"]:
    """Compute the length (metres) that sizes on each actor are compared with: the diagonal of its box."""
    return np.array([np.linalg.norm(track.dimensions) for track in tracks], np.float64)


@torch.no_grad()
def densify_and_prune(
    parameters: dict[str, Tensor],
    nodes: UInt16[ndarray, " n"],
    statistics: GrowthStatistics,
    config: DensifyConfig,
    scene_radius: float,
    rng: np.random.Generator,
    allow_scale_pruning: bool,
    radii: Float64[ndarray, " k"] | None = None,
    spared: Bool[ndarray, " n"] | None = None,
) -> DensifyResult:
    """Grow and prune once. Pure: nothing given is changed.

    An actor may lose all its rows: photos have faded them. The scene keeps at least its most opaque Gaussian.

    Args:
        parameters: one row per Gaussian; children inherit whatever is not changed by a split.
        allow_scale_pruning: whether oversized Gaussians go too, which 3DGS does after the first reset.
        radii: `compute_actor_radii` of nodes 1, 2, …; thresholds there are shares of these where they are smaller than
            the scene's.
        spared: rows that are never pruned; None = none.
    """
    device = parameters["means"].device
    lengths = np.full(int(nodes.max(initial=0)) + 1, scene_radius)
    if radii is not None:
        lengths[1:] = np.minimum(scene_radius, radii[: len(lengths) - 1])
    row_lengths = torch.from_numpy(lengths[nodes].astype(np.float32)).to(device)
    kept = None if spared is None else torch.from_numpy(spared).to(device)
    grows, splits, pruned = _choose_rows(parameters, statistics, config, row_lengths, allow_scale_pruning, kept)

    stays, grown = ~(pruned | splits), np.flatnonzero(grows & ~splits)
    halves = np.repeat(np.flatnonzero(splits)[None], 2, axis=0).ravel()
    parents = np.concatenate([np.flatnonzero(stays), grown, halves])
    born = np.arange(len(parents)) >= np.count_nonzero(stays)
    order = np.argsort(nodes[parents], kind="stable")
    gathered = torch.from_numpy(parents).to(device)
    children = {name: value.index_select(0, gathered) for name, value in parameters.items()}
    _scatter_halves(children, len(halves), rng)
    arranged = torch.from_numpy(order).to(device)
    result = {
        name: value.index_select(0, arranged).requires_grad_(parameters[name].requires_grad)
        for name, value in children.items()
    }
    parents = parents[order]
    return DensifyResult(
        result,
        nodes[parents],
        parents,
        born[order],
        cloned=len(grown),
        split=len(halves) // 2,
        pruned=int(np.count_nonzero(pruned)),
    )


def _choose_rows(
    parameters: dict[str, Tensor],
    statistics: GrowthStatistics,
    config: DensifyConfig,
    lengths: Float[Tensor, " n"],
    allow_scale_pruning: bool,
    spared: Bool[Tensor, " n"] | None = None,
) -> tuple[Bool[ndarray, " n"], Bool[ndarray, " n"], Bool[ndarray, " n"]]:
    """Masks of the rows that grow, of those among them that split, and of those that are pruned.

    gsplat grows first and prunes after; so an oversized Gaussian survives if its halves are no longer too large.
    """
    logits = parameters["opacity_logits"]
    sizes = parameters["log_scales"].max(dim=1).values.exp() / lengths
    gradients = statistics.mean_gradients()
    wants, large = gradients > config.gradient_threshold, sizes > config.clone_scale
    pruned = torch.sigmoid(logits) < config.prune_opacity
    oversized = (sizes > config.prune_scale) & allow_scale_pruning
    if spared is not None:
        pruned, oversized = pruned & ~spared, oversized & ~spared
    pruned |= oversized & ~(wants & large & (sizes <= _SPLIT_SHRINKS * config.prune_scale))
    room = max(0, config.max_gaussians - int((~pruned).sum()))
    grows = _choose_largest(gradients, wants & ~pruned, room)
    pruned |= oversized & ~grows
    if bool(pruned.all()) and len(pruned):
        pruned[logits.argmax()] = False
    return grows.cpu().numpy(), (grows & large).cpu().numpy(), pruned.cpu().numpy()


def _choose_largest(values: Float[Tensor, " n"], among: Bool[Tensor, " n"], count: int) -> Bool[Tensor, " n"]:
    """Choose the rows with the `count` largest values among the given ones; of equal ones the first."""
    rows = torch.nonzero(among)[:, 0]
    if len(rows) <= count:
        return among
    order = torch.argsort(values[rows], descending=True, stable=True)
    chosen = torch.zeros_like(among)
    chosen[rows[order[:count]]] = True
    return chosen


def _scatter_halves(children: dict[str, Tensor], halves: int, rng: np.random.Generator) -> None:
    """Turn the last `halves` rows, copies of their parents, into samples from these, smaller by 1.6 (3DGS)."""
    start = len(children["means"]) - halves
    means, log_scales = children["means"][start:], children["log_scales"][start:]
    quats = torch.nn.functional.normalize(children["quats"][start:], dim=1)
    samples = torch.from_numpy(rng.standard_normal((halves, 3), np.float32)).to(means.device)
    offsets = samples * log_scales.exp()
    w, axis = quats[:, :1], quats[:, 1:]
    turning = 2 * torch.linalg.cross(axis, offsets)
    means += offsets + w * turning + torch.linalg.cross(axis, turning)
    log_scales -= float(np.log(_SPLIT_SHRINKS))


# The schedule: `iteration` is that of the step just done, counted from 0, in an RGB stage of `total` steps.


def is_densifying_due(config: DensifyConfig, iteration: int, total: int) -> bool:
    """Whether Gaussians grow and go after this step; never at a reset or while the scene recovers from one."""
    due = iteration >= max(config.start, 1) and iteration % config.every == 0
    return due and counts_gradients(config, iteration, total)


def is_reset_due(config: DensifyConfig, iteration: int, total: int) -> bool:
    """Whether opacities are reset after this step; never so late that no refinement would follow recovery."""
    return 0 < iteration == find_last_reset(config, iteration, total)


def counts_gradients(config: DensifyConfig, iteration: int, total: int) -> bool:
    """Whether the statistics count the gradients of this step.

    They do not once nothing grows any more, nor while opacities recover: in the dark, everything asks to grow.
    """
    reset = find_last_reset(config, iteration, total)
    recovers = reset > 0 and iteration - reset < _recovery(config)
    return config.max_gaussians > 0 and iteration < config.stop * total and not recovers


def find_last_reset(config: DensifyConfig, iteration: int, total: int) -> int:
    """Find the step of the latest reset up to `iteration`, this one included; 0 where there was none."""
    if config.max_gaussians == 0:
        return 0
    latest = math.ceil(config.stop * total) - 1 - _recovery(config) - config.every
    return max(0, min(iteration, latest) // config.reset_every * config.reset_every)


def _recovery(config: DensifyConfig) -> int:
    return min(_RECOVERY * config.every, config.reset_every // 2)


@torch.no_grad()
def reset_opacities(parameters: dict[str, Tensor], optimizer: VisibleAdam, config: DensifyConfig) -> None:
    """Make nothing more opaque than twice `prune_opacity`, in place, and forget the opacities' moments."""
    name, opacity = "opacity_logits", 2 * config.prune_opacity
    parameters[name].clamp_(max=math.log(opacity / (1 - opacity)))
    optimizer.first[name].zero_()
    optimizer.second[name].zero_()
