"""The first Gaussians of the shadow that a moving vehicle takes along: faint, black and flat, around its foot."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from instdrive_core.instances.shadows import find_learned_shadows
from instdrive_core.maths.activations import logit
from instdrive_core.maths.spherical_harmonics import REST_COUNTS, dc_from_color
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.track import Track
from instdrive_core.training.gaussians.model import SceneModel

LENGTH, MARGIN, LONGEST = 1.3, 0.3, 5.0
"""Metres of shadow for each metre of height (the sun at 38 degrees), around any thing, and at most."""

LEAST = (1.2, 2.5)
"""Metres: width and length of the smallest vehicle with a shadow of its own. Around people and bicycles most of the
ground is hidden by something in most photos, and what hides it has a shadow, too, which would become theirs."""
SPACING = 0.35
"""Metres from one to the next."""
OPACITY = 0.02
"""Faint enough that what no photo tells, because something always stood before it, is not seen as a shadow."""
SPREAD = 0.2
"""Standard deviation along the ground, metres."""
LIFT, THICKNESS = 0.05, 0.01
"""Metres above the box's lower face, and their standard deviation across it."""


def make_first_shadow(track: Track, sh_degree: int) -> Gaussians:
    """Lay Gaussians in the track's box frame that photos make darker, or fade where there is no shadow.

    What is smaller than a car gets none.
    """
    half = track.dimensions / 2
    reach = min(MARGIN + LENGTH * float(track.dimensions[2]), LONGEST)
    counts = np.ceil((half[:2] + reach) / SPACING).astype(int)
    axes = [np.arange(-count, count + 1) * SPACING for count in counts]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = places[np.hypot(*np.maximum(np.abs(places) - half[:2], 0).T) <= reach]
    if (track.dimensions[:2] < LEAST).any():
        places = places[:0]
    count = len(places)
    sizes = np.tile(np.log([SPREAD, SPREAD, THICKNESS]), (count, 1))
    quats = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))
    return Gaussians(
        means=np.c_[places, np.full(count, LIFT - half[2])].astype(np.float32),
        quats=quats,
        log_scales=sizes.astype(np.float32),
        opacity_logits=np.full(count, logit(np.array([OPACITY]))[0], np.float32),
        sh_dc=dc_from_color(np.zeros((count, 3))).astype(np.float32),
        sh_rest=np.zeros((count, REST_COUNTS[sh_degree], 3), np.float32),
        features=np.zeros((count, 0), np.float32),
    )


def find_model_shadows(model: SceneModel) -> Bool[ndarray, " n"]:
    """Find what is a shadow of a moving object by now (`find_learned_shadows`); the model is on the CPU."""
    means, quats, log_scales, colors = (
        model.parameters[name].detach().numpy() for name in ("means", "quats", "log_scales", "sh_dc")
    )
    boxes = np.array([track.dimensions for track in model.actor_poses.tracks], np.float64).reshape(-1, 3)
    return find_learned_shadows(means, quats, log_scales, colors, model.nodes, boxes)
