"""Streams of random numbers: every use of a seed draws from a generator of its own.

NumPy pads the entropy of a seed with zeros, so `default_rng((seed, 3))` and `default_rng((seed, 3, 0))` give the same
numbers. A spawn key is not padded: generators of different streams, or of different numbers within a stream, are
independent.

Two places keep bare seeds, `default_rng(seed)`, which no stream repeats: the synthetic street
(`datasets/synthetic`), whose looks belong to its seed, and the filling of holes (`edits/holes`), because saved projects
replay it.
"""

from __future__ import annotations

from enum import IntEnum, unique

import numpy as np


@unique
class Stream(IntEnum):
    """What random numbers are drawn for. Values are never reused: a run repeats only while they stay.

    They start above the spawn keys 0, 1, … that `SeedSequence.spawn` hands to the parts of the synthetic street.
    """

    LIDAR_THINNING = 1001
    """Which LiDAR points stay where a voxel or an actor has too many."""
    SWEEP_SAMPLE = 1002
    """Which points of one sweep are gathered; by time step."""
    BEYOND_LIDAR = 1003
    """First points where LiDAR is silent; by view."""
    WITHOUT_LIDAR = 1004
    """First points of clips without LiDAR; by view."""
    FIRST_FEATURES = 1005
    """Instance features before training."""
    RGB_VIEWS = 1006
    """Order of the views in the RGB stage; by epoch."""
    DENSIFY = 1007
    """Where the halves of split Gaussians lie; by step."""
    JOINT_PIXELS = 1008
    """Pixels of the instance losses that ride along with the RGB stage; by step."""
    JOINT_VOXELS = 1009
    """Offset of the voxels in the RGB stage; by step."""
    INSTANCE_VIEWS = 1010
    """Order of the views in the instance stage; by epoch."""
    INSTANCE_VOXELS = 1011
    """Offset of the voxels in the instance stage; by step."""
    MASKED_PIXELS = 1012
    """Sampled pixels whose blending weights are cached; by view."""
    EDGE_TAGS = 1013
    """Tags of the objects whose edges are learned; by step."""

    BASELINE_FEATURES = 1101
    """First features of a baseline."""
    BASELINE_CLUSTERS = 1102
    """First centres of OpenGaussian's codebook."""
    BASELINE_CLASSIFIER = 1103
    """First weights of Gaussian Grouping's classifier."""
    GROUPING_VIEWS = 1104
    """Order of the views of Gaussian Grouping; by epoch."""
    GROUPING_NEIGHBORS = 1105
    """Gaussians that its 3D term looks at; by step."""
    OPENGAUSSIAN_FEATURE_VIEWS = 1106
    """Order of the views of OpenGaussian's contrastive stage; by epoch."""
    OPENGAUSSIAN_COARSE_VIEWS = 1107
    """Order of the views of its coarse codebook stage; by epoch."""
    OPENGAUSSIAN_FINE_VIEWS = 1108
    """Order of the views of its fine codebook stage; by epoch."""

    MASK_LABELS = 1201
    """Order of the labels in a frame's label map; by frame."""
    MASK_FAULTS = 1202
    """Faults put into perfect masks; by frame."""

    CLICKS = 1301
    """Pixels that are clicked on; by view and object."""
    DELETIONS = 1302
    """Deletions that are measured where there are too many."""
    RANDOM_IDS = 1304
    """IDs of the random control."""

    POSE_NOISE = 1401
    """Noise of a synthetic clip's written poses; by sensor and step."""
    EXPOSURE_DRIFT = 1402
    """Drift of a synthetic camera's exposure; by camera."""
    CUBOID_ERRORS = 1403
    """Errors of synthetic cuboids; by annotation and step."""
    TWIN_CUBOIDS = 1404
    """IDs and delays of second annotations."""

    LIDAR_NOISE = 1601
    """Noise of the ranges of recorded sweeps; by time step."""
    LIDAR_DROP = 1602
    """Which rays of recorded sweeps are lost; by time step."""

    SOG_PALETTE = 1501
    """First centres of the palette of a .sog file's harmonics."""


def make_generator(seed: int, stream: Stream, *numbers: int) -> np.random.Generator:
    """Make the generator of a stream.

    Args:
        seed: 0 or more; of the whole run.
        stream: what the numbers are for.
        numbers: tell uses within the stream apart (view, step, …); each from 0 to 2³² - 1.

    Raises:
        ValueError: `seed` or one of `numbers` is negative, or a number needs more than 32 bits.
    """
    if any(number >= 1 << 32 for number in numbers):
        raise ValueError(f"numbers of a random stream have 32 bits, got {numbers}")
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(stream), *map(int, numbers))))
