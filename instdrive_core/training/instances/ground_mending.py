"""What LiDAR's ground says of instances that were learned from masks."""

from __future__ import annotations

from jaxtyping import Float32, Int64
from numpy import ndarray

from instdrive_core.maths.spherical_harmonics import color_from_dc
from instdrive_core.maths.splat_axes import compute_thicknesses
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.ground_claims import claim_flat
from instdrive_core.training.instances.ground_height import measure_heights
from instdrive_core.training.instances.level_ground import join_level_ground
from instdrive_core.training.instances.standing_things import part_standing_things


def mend_ground(
    groups: Int64[ndarray, " n"],
    shown: Float32[ndarray, " n"],
    model: SceneModel,
    ground: Float32[ndarray, "p 3"],
    things: Int64[ndarray, " n"],
) -> Int64[ndarray, " n"]:
    """Join the pieces of a road, give it back the shadows of cars, and part from it what stands on it.

    Args:
        groups: of each Gaussian; -1 = none.
        shown: how much of the photos each shows.
        model: the Gaussians, of which those on actors keep their groups, as far as these are not joined.
        ground: LiDAR points of the ground, in metres in the world; z is up.
        things: the standing thing that each is part of, by LiDAR; -1 = none (`assign_lidar_things`).
    """
    names = ("means", "quats", "log_scales", "sh_dc")
    means, quats, log_scales, sh_dc = (model.parameters[name].detach().numpy() for name in names)
    heights = measure_heights(means, ground)
    groups = join_level_ground(groups, shown, model.nodes, means, color_from_dc(sh_dc), ground, heights)
    groups = claim_flat(groups, shown, model.nodes, means, compute_thicknesses(quats, log_scales), heights)
    return part_standing_things(groups, shown, model.nodes, heights, things)
