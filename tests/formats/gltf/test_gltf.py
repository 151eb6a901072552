"""glTF scenes: instances as nodes, values as the extension defines them, files of others, and hostile files."""

import base64
import dataclasses
import json
import struct

import numpy as np
import pytest
import trimesh
from random_scene import random_scene

from instdrive_core.errors import DataError
from instdrive_core.formats.gltf.container import open_gltf
from instdrive_core.formats.gltf.nodes import list_nodes
from instdrive_core.formats.instance_parts import order_by_instance
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import evaluate_view_colors
from instdrive_core.scene.scene import Scene

EXTENSION = "KHR_gaussian_splatting"


def street(seed=0, count=300) -> Scene:
    scene = dataclasses.replace(random_scene(seed, count, actors=0), sky=None, views=())
    scene.gaussians.opacity_logits = np.clip(scene.gaussians.opacity_logits, -8, 8)
    return scene


def change(path, edit):
    """Change the JSON of a .gltf."""
    content = json.loads(path.read_text())
    edit(content)
    path.write_text(json.dumps(content))


@pytest.fixture(params=["a.glb", "a.gltf"])
def path(request, tmp_path):
    return tmp_path / request.param


def test_everything_but_features_comes_back(path):
    scene = street()
    save_scene(path, scene)
    found, order = open_scene(path), order_by_instance(scene)
    wanted = scene.gaussians.select(order)
    for name in ("means", "sh_dc", "sh_rest"):
        np.testing.assert_array_equal(getattr(found.gaussians, name), getattr(wanted, name))
    np.testing.assert_allclose(found.gaussians.quats, normalize_quaternions(wanted.quats), atol=1e-6)
    np.testing.assert_allclose(found.gaussians.log_scales, wanted.log_scales, atol=1e-5)
    np.testing.assert_allclose(found.gaussians.opacities, wanted.opacities, atol=1e-6)
    np.testing.assert_array_equal(found.instance_ids, scene.instance_ids[order])
    np.testing.assert_array_equal(found.origin, scene.origin)
    assert [(entry.id, entry.name, entry.class_name, entry.codeword) for entry in found.table] == [
        (entry.id, entry.name, entry.class_name, entry.codeword) for entry in scene.table
    ]
    assert (found.code_bits, found.antialiased) == (scene.code_bits, scene.antialiased)


def test_the_tree_is_as_gltf_wants_it(tmp_path):
    scene = street()
    save_scene(tmp_path / "a.gltf", scene)
    content = json.loads((tmp_path / "a.gltf").read_text())
    assert content["extensionsUsed"] == [EXTENSION]
    ids = [node["extras"]["id"] for node in content["nodes"][1:]]
    assert ids == np.unique(scene.instance_ids).tolist()
    assert len({node["name"] for node in content["nodes"]}) == len(content["nodes"])
    for mesh in content["meshes"]:
        (primitive,) = mesh["primitives"]
        assert primitive["mode"] == 0
        assert primitive["extensions"][EXTENSION]["kernel"] == "ellipse"
        assert primitive["extensions"][EXTENSION]["colorSpace"] == "srgb_rec709_display"


def test_another_program_finds_the_points_with_y_up(tmp_path):
    scene = street()
    save_scene(tmp_path / "a.glb", scene)
    loaded = trimesh.load(tmp_path / "a.glb")
    for entry in scene.table:
        matrix, geometry = loaded.graph[entry.name]
        points = trimesh.transform_points(loaded.geometry[geometry].vertices, matrix)
        x, y, z = scene.gaussians.means[scene.instance_ids == entry.id].T
        np.testing.assert_allclose(points, np.c_[x, z, -y], rtol=1e-6)


def test_values_are_what_the_extension_defines(tmp_path):
    scene = street(count=5)
    scene.instance_ids[:] = 0
    save_scene(tmp_path / "a.gltf", scene)
    content = json.loads((tmp_path / "a.gltf").read_text())
    data = base64.b64decode(content["buffers"][0]["uri"].split(",")[1])

    def read(name, width):
        accessor = content["accessors"][content["meshes"][0]["primitives"][0]["attributes"][f"{EXTENSION}:{name}"]]
        start = content["bufferViews"][accessor["bufferView"]]["byteOffset"] + accessor["byteOffset"]
        return np.frombuffer(data, "<f4", 5 * width, start).reshape(5, width)

    gaussians = scene.gaussians
    quats = normalize_quaternions(gaussians.quats)
    np.testing.assert_allclose(read("ROTATION", 4), quats[:, [1, 2, 3, 0]], atol=1e-6)
    np.testing.assert_allclose(read("SCALE", 3), np.exp(gaussians.log_scales), rtol=1e-5)
    np.testing.assert_allclose(read("OPACITY", 1)[:, 0], 1 / (1 + np.exp(-gaussians.opacity_logits)), rtol=1e-5)
    last = 2 * gaussians.sh_degree
    coefficient = read(f"SH_DEGREE_{gaussians.sh_degree}_COEF_{last}", 3)
    np.testing.assert_array_equal(coefficient, gaussians.sh_rest[:, -1])


def test_nodes_turn_move_and_scale_splats(tmp_path):
    scene = street(count=40)
    scene.instance_ids[:] = 0
    save_scene(tmp_path / "a.gltf", scene)

    def turn(content):
        content["nodes"][1] |= {"rotation": [0, 0, 0.6, 0.8], "translation": [1, 2, 3], "scale": [2, 2, 2]}

    change(tmp_path / "a.gltf", turn)
    found, before = open_scene(tmp_path / "a.gltf").gaussians, scene.gaussians
    rotation = np.array([[0.28, -0.96, 0], [0.96, 0.28, 0], [0, 0, 1]])
    np.testing.assert_allclose(found.means, 2 * before.means @ rotation.T + [1, 2, 3], rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(found.log_scales, before.log_scales + np.log(2), atol=1e-5)
    directions = normalize_quaternions(np.random.default_rng(0).normal(size=(40, 4)))[:, 1:].astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turned = evaluate_view_colors(found.sh_dc, found.sh_rest, (directions @ rotation.T).astype(np.float32))
    np.testing.assert_allclose(turned, evaluate_view_colors(before.sh_dc, before.sh_rest, directions), atol=1e-4)


@pytest.mark.parametrize("kind", ["whole numbers", "buffer beside", "interleaved"])
def test_other_layouts_are_read(tmp_path, kind):
    rows = np.zeros(4, [("p", "<f4", 3), ("r", "<i2", 4), ("s", "<u2", 3), ("o", "u1"), ("pad", "u1"), ("c", "<f4", 3)])
    rows["p"], rows["r"], rows["s"], rows["o"] = np.arange(12).reshape(4, 3), [0, 0, 0, 32767], [1, 2, 3], 51
    rows["c"] = 0.25
    (tmp_path / "data.bin").write_bytes(rows.tobytes())
    uri = "data.bin" if kind == "buffer beside" else f"data:;base64,{base64.b64encode(rows.tobytes()).decode()}"
    formats = {
        "p": (5126, "VEC3"),
        "r": (5122, "VEC4"),
        "s": (5123, "VEC3"),
        "o": (5121, "SCALAR"),
        "c": (5126, "VEC3"),
    }
    accessors = [
        {
            "bufferView": 0,
            "byteOffset": rows.dtype.fields[name][1],
            "componentType": component,
            "type": shape,
            "count": 4,
        }
        | ({"normalized": True} if name in "ro" else {})
        for name, (component, shape) in formats.items()
    ]
    names = ["POSITION", *(f"{EXTENSION}:{name}" for name in ("ROTATION", "SCALE", "OPACITY", "SH_DEGREE_0_COEF_0"))]
    primitive = {"mode": 0, "attributes": {name: number for number, name in enumerate(names)}}
    primitive["extensions"] = {EXTENSION: {"kernel": "ellipse", "colorSpace": "lin_rec709_display"}}
    content = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive, {"attributes": {}}]}],
        "accessors": accessors,
        "bufferViews": [{"buffer": 0, "byteLength": rows.nbytes, "byteStride": rows.itemsize}],
        "buffers": [{"byteLength": rows.nbytes, "uri": uri}],
    }
    (tmp_path / "a.gltf").write_text(json.dumps(content))
    found = open_scene(tmp_path / "a.gltf")
    np.testing.assert_array_equal(found.gaussians.means[1], [3, -5, 4])
    np.testing.assert_allclose(found.gaussians.log_scales, np.log([[1, 2, 3]] * 4), rtol=1e-6)
    np.testing.assert_allclose(found.gaussians.opacities, 0.2, rtol=1e-5)
    np.testing.assert_allclose(found.gaussians.quats, [[np.sqrt(0.5), np.sqrt(0.5), 0, 0]] * 4, atol=1e-4)
    assert len(found.left_out) == 2
    assert "lin_rec709_display" in found.left_out[0]


def first_primitive(content):
    return content["meshes"][0]["primitives"][0]


HOSTILE = {
    "stands in the tree twice": lambda c: c["nodes"][1].update(children=[0]),
    "is none of its": lambda c: c["nodes"][1].update(mesh=99),
    "beyond the end of its buffer": lambda c: c["accessors"][0].update(byteOffset=1 << 40),
    "rows where positions": lambda c: c["accessors"][1].update(count=1 << 40),
    "not a whole number": lambda c: c["accessors"][0].update(count=-1),
    "no mesh of its scene has splats": lambda c: [m["primitives"][0].pop("extensions") for m in c["meshes"]],
    "are not read": lambda c: first_primitive(c)["extensions"][EXTENSION].update(kernel="cube"),
    "which is not read": lambda c: first_primitive(c)["extensions"][EXTENSION].update(extensions={"X_packed": {}}),
    "lack coefficients": lambda c: first_primitive(c)["attributes"].pop(f"{EXTENSION}:SH_DEGREE_1_COEF_1"),
    "lack the attribute": lambda c: first_primitive(c)["attributes"].pop(f"{EXTENSION}:SCALE"),
    "stretched unevenly": lambda c: c["nodes"][1].update(scale=[1, 2, 1]),
    "is mirrored": lambda c: c["nodes"][1].update(scale=[-1, 1, 1]),
    "is no file beside the scene": lambda c: c["buffers"][0].update(uri="../../etc/passwd"),
    "is missing": lambda c: c["buffers"][0].update(uri="gone.bin"),
    "is no base64": lambda c: c["buffers"][0].update(uri="data:;base64,?"),
}


@pytest.mark.parametrize("problem", HOSTILE)
def test_hostile_files_are_refused(tmp_path, problem):
    save_scene(tmp_path / "a.gltf", street(count=60))
    change(tmp_path / "a.gltf", HOSTILE[problem])
    with pytest.raises(DataError, match=problem):
        open_scene(tmp_path / "a.gltf")


def test_opacity_out_of_range_is_refused(tmp_path):
    save_scene(tmp_path / "a.glb", street(count=60))
    content = bytearray((tmp_path / "a.glb").read_bytes())
    gltf = open_gltf(tmp_path / "a.glb")
    view = gltf.content["bufferViews"][3]["byteOffset"]
    start = len(content) - gltf.content["buffers"][0]["byteLength"] + view
    content[start : start + 4] = struct.pack("<f", 1.5)
    (tmp_path / "a.glb").write_bytes(content)
    with pytest.raises(DataError, match=r"opacity of splat 0 .* is 1\.5"):
        open_scene(tmp_path / "a.glb")


def test_actors_stand_where_they_are_at_one_time(tmp_path):
    with pytest.raises(DataError, match="actors that move"):
        save_scene(tmp_path / "a.glb", random_scene())


def test_a_deep_tree_is_walked(tmp_path):
    save_scene(tmp_path / "a.gltf", street(count=20))

    def deepen(content):
        first = len(content["nodes"])
        content["nodes"] += [{"children": [first + number + 1]} for number in range(5000)] + [{"children": [0]}]
        content["scenes"][0]["nodes"] = [first]

    change(tmp_path / "a.gltf", deepen)
    assert len(list_nodes(open_gltf(tmp_path / "a.gltf"))) > 5000
    assert len(open_scene(tmp_path / "a.gltf")) == 20
