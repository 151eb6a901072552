"""Boxes and hulls of instances, read back by programs that know nothing of ours."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from random_scene import assert_same_scene, random_scene

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.errors import DataError
from instdrive_core.formats.objects.writers import write_objects
from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.instances.table import build_instance_table
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.scene.gaussians import create_empty_gaussians
from instdrive_core.scene.scene import scene_from_gaussians

PARKED, DRIVING, LONELY, FLAT = 1, 2, 3, 4
SIZE = np.array([4.0, 2.0, 1.0])
TIME = 0.25


@pytest.fixture
def scene():
    """A parked and a driving block of 4 × 2 × 1 m, a single splat and a flat sign."""
    rng = np.random.default_rng(0)
    blocks = rng.uniform(-0.5, 0.5, (2, 400, 3))
    for face in range(3):  # splats lie on surfaces
        blocks[:, face::3, face] = np.sign(blocks[:, face::3, face]) / 2
    blocks[0] *= SIZE
    blocks[1] *= SIZE[[1, 0, 2]]  # a track's y is forward
    parked = blocks[0] @ turn(0.5).T + [10, 5, 1]
    flat = rng.uniform(-0.5, 0.5, (30, 3)) * [2, 0, 1]
    start = random_scene(seed=1, count=831, instances=4, actors=1, degree=0, features=0)
    gaussians = start.gaussians
    gaussians.means[:] = np.concatenate([parked, [[-3, -3, 0]], flat, blocks[1]])
    gaussians.log_scales[:] = np.log(0.01)
    gaussians.opacity_logits[:] = 3
    ids = np.repeat([PARKED, LONELY, FLAT, DRIVING], [400, 1, 30, 400]).astype(np.uint32)
    nodes = (ids == DRIVING).astype(np.uint16)
    names = {PARKED: "parked – “taxi”", DRIVING: "parked – “taxi”"}
    table = build_instance_table(ids, gaussians.means, start.codewords, nodes, names, {DRIVING: "Car"})
    return replace(start, instance_ids=ids, nodes=nodes, table=table)


def turn(yaw):
    return np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])


def read_json(path):
    content = json.loads(path.read_text(encoding="utf-8"))
    return content, {entry["id"]: entry for entry in content["objects"]}


def test_json_says_what_stands_where(scene, tmp_path):
    write_objects(tmp_path / "a.json", scene, TIME)
    content, objects = read_json(tmp_path / "a.json")
    assert list(objects) == [PARKED, DRIVING, LONELY, FLAT]
    assert content["origin"] == scene.origin.tolist()
    assert "z up" in content["conventions"]["axes"]
    parked = objects[PARKED]
    assert (parked["name"], parked["count"], parked["track"]) == ("parked – “taxi”", 400, None)
    np.testing.assert_allclose(parked["box"]["center"], [10, 5, 1], atol=0.1)
    np.testing.assert_allclose(parked["box"]["size"], SIZE, atol=0.2)
    assert parked["box"]["yaw"] == pytest.approx(0.5, abs=0.03)
    low, high = np.array(parked["bounds"]["min"]), np.array(parked["bounds"]["max"])
    corners = (np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * SIZE[:2] / 2) @ turn(0.5)[:2, :2].T
    assert ((high - low)[:2] < corners.max(axis=0) - corners.min(axis=0)).all()
    assert ((high - low)[:2] > 0.8 * (corners.max(axis=0) - corners.min(axis=0))).all()
    assert ids_from_colors(np.array([list(bytes.fromhex(parked["color"][1:]))], np.uint8)) == [PARKED]
    np.testing.assert_allclose(objects[LONELY]["box"]["size"], 0.02, rtol=1e-3)


def test_what_moves_follows_its_track(scene, tmp_path):
    (actor,) = scene.actors
    sizes = []
    for time in (0.0, 0.4):
        write_objects(tmp_path / "a.json", scene, time)
        content, objects = read_json(tmp_path / "a.json")
        pose, driving = actor.interpolate_pose(time), objects[DRIVING]
        np.testing.assert_allclose(driving["box"]["center"], pose[:3, 3], atol=0.1)
        heading = math.atan2(pose[1, 1], pose[0, 1])
        assert math.cos(driving["box"]["yaw"] - heading) == pytest.approx(1)
        assert driving["box"]["heading"]
        sizes.append(driving["box"]["size"])
    np.testing.assert_allclose(sizes[0], SIZE, atol=0.2)
    np.testing.assert_allclose(sizes[0], sizes[1], atol=1e-3)
    (track,) = content["tracks"]
    assert track["id"] == driving["track"] == actor.id
    # A reader may place the box at any of the track's times.
    local = driving["box_in_track"]
    rotation, position = matrix_from_quaternion(np.array(track["rotations"][-1])), np.array(track["positions"][-1])
    np.testing.assert_allclose(rotation @ local["center"] + position, driving["box"]["center"], atol=1e-3)


def test_before_its_track_an_object_is_not_there(scene, tmp_path):
    late = replace(scene.actors[0], times=scene.actors[0].times + 5)
    scene.actors = (late,)
    written = write_objects(tmp_path / "a.json", scene, TIME)
    _, objects = read_json(tmp_path / "a.json")
    assert {number: entry["present"] for number, entry in objects.items()} == {1: True, 2: False, 3: True, 4: True}
    assert len(written) == 4
    assert len(write_objects(tmp_path / "a.glb", scene, TIME)) == 3
    assert len(trimesh.load(tmp_path / "a.glb").geometry) == 3


@pytest.mark.parametrize("shape", ["box", "hull"])
def test_glb_opens_elsewhere_with_y_up(scene, tmp_path, shape):
    objects = write_objects(tmp_path / "a.glb", scene, TIME, shape)
    loaded = trimesh.load(tmp_path / "a.glb")
    assert len(loaded.geometry) == len(loaded.graph.nodes_geometry) == 4
    assert {"parked – “taxi”", f"parked – “taxi” ({DRIVING})", f"instance {LONELY}"} <= set(loaded.graph.nodes_geometry)
    by_id = {}
    for node in loaded.graph.nodes_geometry:
        matrix, geometry = loaded.graph[node]
        facts = loaded.graph.transforms.edge_data[(loaded.graph.transforms.parents[node], node)]["metadata"]
        by_id[facts["id"]] = (matrix, loaded.geometry[geometry], facts)
    for entry in objects:
        matrix, mesh, facts = by_id[entry.instance.id]
        corners = trimesh.transform_points(mesh.vertices, matrix)
        z_up = corners[:, [0, 2, 1]] * [1, -1, 1]
        assert entry.box.holds(z_up, 0.01).all()
        assert mesh.is_watertight
        assert mesh.volume > 0
        assert facts["class"] == entry.instance.class_name
        assert facts["shape"] == ("hull" if shape == "hull" and entry.instance.id in (PARKED, DRIVING) else "box")
        if facts["shape"] == "box":
            np.testing.assert_allclose(mesh.extents, entry.box.size, rtol=1e-5)
        else:
            assert 0.75 * np.prod(SIZE) < mesh.volume < np.prod(entry.box.size)
    np.testing.assert_allclose(loaded.metadata["origin"], scene.origin)


def test_glb_colours_are_those_of_the_ids(scene, tmp_path):
    write_objects(tmp_path / "a.glb", scene, TIME)
    content = (tmp_path / "a.glb").read_bytes()
    tree = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    seen = set()
    for material in tree["materials"]:
        linear = np.array(material["pbrMetallicRoughness"]["baseColorFactor"][:3])
        shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        seen.update(ids_from_colors(np.round(shown * 255).astype(np.uint8)[None]).tolist())
    assert seen == {PARKED, DRIVING, LONELY, FLAT}


def test_hulls_stand_beside_boxes_in_json(scene, tmp_path):
    write_objects(tmp_path / "a.json", scene, TIME, "hull")
    _, objects = read_json(tmp_path / "a.json")
    assert "hull" not in objects[LONELY]
    assert "hull" not in objects[FLAT]
    mesh = trimesh.Trimesh(objects[PARKED]["hull"]["vertices"], objects[PARKED]["hull"]["faces"])
    assert mesh.is_watertight
    assert 0.75 * np.prod(SIZE) < mesh.volume < np.prod(SIZE)


def test_floaters_damage_and_haze_change_nothing(scene, tmp_path):
    write_objects(tmp_path / "a.json", scene, TIME)
    clean = read_json(tmp_path / "a.json")[1][PARKED]["box"]
    gaussians = scene.gaussians
    gaussians.means[0], gaussians.means[1] = [500, 0, 0], np.nan
    gaussians.quats[2], gaussians.log_scales[3] = 0, np.inf
    gaussians.log_scales[4] = 30
    gaussians.opacity_logits[[41, 42, 43]] = np.nan, -np.inf, np.inf
    gaussians.means[5:40], gaussians.opacity_logits[5:40] = [14, 5, 9], -6
    write_objects(tmp_path / "b.json", scene, TIME)
    damaged = read_json(tmp_path / "b.json")[1][PARKED]["box"]
    np.testing.assert_allclose(damaged["center"], clean["center"], atol=0.1)
    np.testing.assert_allclose(damaged["size"], clean["size"], atol=0.2)


def test_an_edited_scene_is_written_as_edited(scene, tmp_path):
    document = Document(scene)
    document.apply(DeleteInstances((PARKED,)))
    write_objects(tmp_path / "a.json", bake_document(document), TIME)
    assert list(read_json(tmp_path / "a.json")[1]) == [DRIVING, LONELY, FLAT]


def test_nothing_is_changed_and_odd_requests_are_refused(scene, tmp_path):
    before = random_scene(seed=3)
    write_objects(tmp_path / "a.json", before, TIME, "hull")
    assert_same_scene(before, random_scene(seed=3))
    with pytest.raises(DataError, match=r"ends in '\.obj'"):
        write_objects(tmp_path / "a.obj", scene, TIME)
    with pytest.raises(DataError, match="time is nan"):
        write_objects(tmp_path / "b.json", scene, math.nan)
    scene.instance_ids[:] = 0
    with pytest.raises(DataError, match="no instances"):
        write_objects(tmp_path / "b.json", scene, TIME)
    with pytest.raises(DataError, match="no instances"):
        write_objects(tmp_path / "b.json", scene_from_gaussians(create_empty_gaussians(0, 0)), TIME)
    assert not (tmp_path / "b.json").exists()
