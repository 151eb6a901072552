"""Colours of visible splats, recoloured and turned, against plain numpy."""

import numpy as np
import pytest
from little_scenes import random_splats, small_camera

from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.spherical_harmonics import REST_COUNTS, Y0, evaluate_rest_basis
from instdrive_core.maths.workspace import Workspace
from instdrive_core.rasterize.kernels.settings import DEFAULT_SETTINGS
from instdrive_core.rasterize.preview.colors import ColorSource
from instdrive_core.rasterize.preview.projection import project_part
from instdrive_core.rasterize.preview.splats import ProjectedSplats


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_visible_rows_get_the_color_of_their_direction_in_their_frame(degree):
    camera, rng, count = small_camera(), np.random.default_rng(degree), 700
    splats = random_splats(camera, count, 3, seed=degree)
    opacities = np.where(rng.random(count) < 0.3, 0, splats.opacities).astype(np.float32)
    source = ColorSource(
        sh_dc=rng.normal(size=(count, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.3, (count, REST_COUNTS[degree], 3)).astype(np.float32),
        frames=rng.integers(0, 3, count).astype(np.int32),
        rotations=np.stack([np.eye(3), *matrix_from_quaternion(rng.normal(size=(2, 4)))]).astype(np.float32),
        entries=rng.integers(0, 3, count).astype(np.uint16),
        matrices=np.concatenate([np.eye(3, 4)[None], rng.normal(0, 0.5, (2, 3, 4))]).astype(np.float32),
    )
    shapes = (np.ascontiguousarray(a, np.float32) for a in splats.arrays()[:3])
    means, quats, log_scales = shapes
    found = ProjectedSplats(count, Workspace())
    found.colors[:] = -7
    project_part(means, quats, log_scales, opacities, camera, DEFAULT_SETTINGS, source, found)

    away = means - camera.position
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    local = np.einsum("nij,ni->nj", source.rotations[source.frames], away)
    rest = np.einsum("nk,nkc->nc", evaluate_rest_basis(local, REST_COUNTS[degree]), source.sh_rest)
    plain = 0.5 + Y0 * source.sh_dc + rest
    matrices = source.matrices[source.entries]
    expected = np.maximum(np.einsum("nij,nj->ni", matrices[:, :, :3], plain) + matrices[:, :, 3], 0)
    visible = found.depths > 0
    assert 0.2 < visible.mean() < 0.9
    np.testing.assert_allclose(found.colors[visible], expected[visible], atol=2e-5)
    assert (found.colors[~visible] == -7).all(), "others are not touched"
