"""Random but whole scenes for the tests of formats, edits and commands."""

import numpy as np

from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.spherical_harmonics import REST_COUNTS
from instdrive_core.scene.camera import Camera, CameraView, look_at
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.track import Track


def random_gaussians(rng, count, degree=3, features=4):
    """`count` Gaussians of all sizes within a few metres."""
    rest = REST_COUNTS[degree]
    return Gaussians(
        means=rng.normal(0, 3, (count, 3)).astype(np.float32),
        quats=rng.normal(size=(count, 4)).astype(np.float32),
        log_scales=rng.normal(-3, 0.7, (count, 3)).astype(np.float32),
        opacity_logits=rng.normal(0, 2, count).astype(np.float32),
        sh_dc=rng.normal(0, 1, (count, 3)).astype(np.float32),
        sh_rest=rng.normal(0, 0.2, (count, rest, 3)).astype(np.float32),
        features=rng.normal(size=(count, features)).astype(np.float32),
    )


def random_track(rng, name, start=0.0, steps=5):
    """A box that drives and turns for `steps` tenths of a second from `start`."""
    angles, poses = rng.uniform(-np.pi, np.pi) + np.linspace(0, 0.5, steps), np.tile(np.eye(4), (steps, 1, 1))
    poses[:, 0, 0], poses[:, 0, 1], poses[:, 1, 0] = np.cos(angles), -np.sin(angles), np.sin(angles)
    poses[:, 1, 1] = np.cos(angles)
    poses[:, :3, 3] = rng.uniform(-5, 5, 3) + np.linspace(0, 1, steps)[:, None] * rng.uniform(-2, 2, 3)
    return Track(name, "Car", np.array([1.9, 4.5, 1.6]), start + 0.1 * np.arange(steps), poses, moving=True)


def random_scene(seed=0, count=200, instances=6, actors=2, degree=3, features=4):
    """A scene with every part filled: instance 0 … `instances`, actors at the end of the rows, sky, views, origin."""
    rng = np.random.default_rng(seed)
    gaussians = random_gaussians(rng, count, degree, features)
    nodes = np.sort(rng.integers(0, actors + 1, count)).astype(np.uint16)
    ids = rng.integers(0, instances + 1, count).astype(np.uint32)
    # An instance lies in one node: actors get IDs of their own.
    ids[nodes > 0] = instances + nodes[nodes > 0]
    codewords = (ids % 3 + 10).astype(np.uint32)
    names, classes = {1: "parked – “taxi”", 2: "a b\\n"}, {1: "Car"}
    views = tuple(
        CameraView(
            Camera(60.0, 61.0, 32.0, 24.0, 64, 48, look_at(np.array([9.0 - index, -8, 3]), np.zeros(3))),
            "front_camera",
            index,
            0.1 * index,
            photo=f"photos/{index:02d}.jpg",
            held_out=index == 4,
        )
        for index in range(5)
    )
    return Scene(
        gaussians=gaussians,
        instance_ids=ids,
        codewords=codewords,
        nodes=nodes,
        table=build_instance_table(ids, gaussians.means, codewords, nodes, names, classes),
        actors=tuple(random_track(rng, f"actor-{k}", 0.2 * k) for k in range(actors)),
        sky=Sky(rng.random((6, 4, 4, 3)).astype(np.float32)),
        views=views,
        origin=np.array([500000.0, 4.2e6, 12.5]),
        code_bits=max(features, 4),
        extra={"confidence": rng.random(count).astype(np.float32)},
    )


def assert_same_scene(left, right):
    """Every array bit-equal (NaN included), every table entry, track and view equal."""
    for name, array in left.gaussians.arrays().items():
        assert array.tobytes() == getattr(right.gaussians, name).tobytes(), name
    for name in ("instance_ids", "codewords", "nodes", "origin"):
        np.testing.assert_array_equal(getattr(left, name), getattr(right, name), err_msg=name)
    assert list(left.table) == list(right.table)
    assert left.code_bits == right.code_bits
    assert left.extra.keys() == right.extra.keys()
    for name, column in left.extra.items():
        assert column.dtype == right.extra[name].dtype
        assert column.tobytes() == right.extra[name].tobytes(), name
    assert (left.sky is None) == (right.sky is None)
    if left.sky is not None:
        np.testing.assert_array_equal(left.sky.faces, right.sky.faces)
    assert len(left.actors) == len(right.actors)
    for mine, theirs in zip(left.actors, right.actors, strict=True):
        assert (mine.id, mine.label, mine.moving) == (theirs.id, theirs.label, theirs.moving)
        for name in ("dimensions", "times", "world_from_box"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name), err_msg=name)
