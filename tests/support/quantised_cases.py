"""Scenes for the formats that round their values, and the measure of what rounding did."""

import numpy as np
from hypothesis import strategies as st
from random_scene import random_gaussians

from instdrive_core.maths.rotations import normalize_quaternions


@st.composite
def hard_gaussians(draw, max_count=700):
    """Gaussians of any spread, far from the origin or not, with values at and beyond the formats' limits."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    gaussians = random_gaussians(rng, draw(st.integers(1, max_count)), draw(st.integers(0, 3)))
    gaussians.means *= np.float32(10.0 ** draw(st.integers(-6, 6)))
    gaussians.means += np.float32(draw(st.sampled_from([0, 0, 1, -1000])))
    gaussians.log_scales *= np.float32(draw(st.sampled_from([0, 1, 1, 5, 20])))
    gaussians.quats *= np.float32(10.0 ** draw(st.integers(-4, 4)))
    gaussians.sh_dc *= np.float32(draw(st.sampled_from([0, 0.5, 1, 30])))
    gaussians.sh_rest *= np.float32(draw(st.sampled_from([0, 1, 1, 20])))
    gaussians.opacity_logits *= np.float32(draw(st.sampled_from([0, 1, 10, 100])))
    row = draw(st.integers(0, len(gaussians) - 1))
    gaussians.quats[row] = draw(st.sampled_from([(0, 0, 0, 0), (1, 0, 0, 0), (0, 0, -1, 0), (1, 1, -1, -1)]))
    gaussians.opacity_logits[row] = draw(st.sampled_from([0, np.inf, -np.inf]))
    return gaussians


def rotation_angles(left, right):
    """Degrees (n,) between the rotations of two arrays of quaternions of any length."""
    left, right = normalize_quaternions(left.astype(np.float64)), normalize_quaternions(right.astype(np.float64))
    # Of both signs the nearer; by chords, which keep their digits where the angle is small.
    chords = np.minimum(np.linalg.norm(left - right, axis=1), np.linalg.norm(left + right, axis=1))
    return np.degrees(4 * np.arcsin(chords / 2))
