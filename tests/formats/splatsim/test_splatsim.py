"""Bundles of splatsim: what its own readers check, tracks and bodies, bundles of others, and those that are refused."""

import json
import zipfile
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.formats.actors.boxes import BOX_FROM_FORWARD_X
from instdrive_core.formats.registry import find_format, open_scene, save_scene
from instdrive_core.formats.splatsim.layout import FRAMES, OBJECT_FRAME
from instdrive_core.formats.splatsim.writing import order_for_bundle
from instdrive_core.formats.spz.axes import RDF
from instdrive_core.formats.spz.scenes import decode_spz, encode_spz
from instdrive_core.maths.rotations import matrix_from_quaternion

NAME = "a.splatsim.usdz"


def street(count=400, actors=2):
    return replace(random_scene(2, count, actors=actors), sky=None, views=())


def read_members(path):
    with zipfile.ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def rewrite(path, changes, name="b.usdz"):
    """The bundle with other members: bytes, a function of the parsed document, or None to leave one out."""
    members = read_members(path)
    for member, change in changes.items():
        if change is None:
            members.pop(member)
            continue
        if callable(change):
            document = json.loads(members[member])
            change(document)
            change = json.dumps(document).encode()
        members[member] = change
    target = path.with_name(name)
    with zipfile.ZipFile(target, "w") as archive:
        for member, data in members.items():
            archive.writestr(member, data)
    return target


@pytest.fixture
def written(tmp_path):
    scene = street()
    save_scene(tmp_path / NAME, scene)
    return tmp_path / NAME, scene


def test_instances_and_tracks_come_back(written):
    path, scene = written
    found, order = open_scene(path), order_for_bundle(scene)
    np.testing.assert_allclose(found.gaussians.means, scene.gaussians.means[order], atol=2e-4)
    np.testing.assert_allclose(found.gaussians.log_scales, scene.gaussians.log_scales[order], atol=1 / 30)
    for name in ("nodes", "instance_ids"):
        still = found.nodes == 0  # a body is one instance, that of most of its splats
        np.testing.assert_array_equal(getattr(found, name)[still], getattr(scene, name)[order][still], err_msg=name)
    np.testing.assert_array_equal(found.nodes, scene.nodes[order])
    np.testing.assert_array_equal(found.origin, scene.origin)
    assert (found.code_bits, found.antialiased, found.left_out) == (scene.code_bits, scene.antialiased, ())
    names = {instance.id: instance.name for instance in scene.table}
    assert {instance.id: instance.name for instance in found.table}.items() <= names.items()
    for mine, theirs in zip(scene.actors, found.actors, strict=True):
        assert (mine.id, mine.label, mine.moving) == (theirs.id, theirs.label, theirs.moving)
        np.testing.assert_allclose(mine.dimensions, theirs.dimensions)
        np.testing.assert_allclose(mine.times, theirs.times, atol=1e-6)
        np.testing.assert_allclose(mine.world_from_box, theirs.world_from_box, atol=1e-9)


def test_a_body_of_the_bundle_is_posed_as_splatsim_poses_it(written):
    """Means times the track's rotation plus its translation, as its schema says, are where this program draws them."""
    path, scene = written
    members = read_members(path)
    assets, tracks = json.loads(members["actor_assets.json"]), json.loads(members["sequence_tracks.json"])
    assert (assets["object_frame"], tracks["frame_convention"]) == (OBJECT_FRAME, FRAMES)
    for row, (asset, binding) in enumerate(zip(assets["assets"], assets["instances"], strict=True)):
        track = next(each for each in tracks["tracks"] if each["track_id"] == binding["track_id"])
        data = members[asset["uri"]]
        local, _ = decode_spz(BytesIO(data), path, len(data), axes=RDF)
        assert asset["n_points"] == len(local)
        np.testing.assert_allclose(track["size"], asset["size"])
        assert max(asset["bbox_min"]) <= 0 <= min(asset["bbox_max"])
        frame = track["frames"][1]
        turn = matrix_from_quaternion(np.roll(np.array(frame["rotation"]), 1))
        placed = local.means @ turn.T + frame["translation"]
        actor = next(each for each in scene.actors if each.id == track["track_id"])
        pose = actor.world_from_box[1]
        expected = scene.gaussians.means[scene.nodes == row + 1] @ pose[:3, :3].T + pose[:3, 3]
        np.testing.assert_allclose(placed, expected, atol=2e-3)


def test_the_package_is_what_usd_wants(written):
    """Nothing compressed, the stage first, the data of each member at a multiple of 64 bytes; no clock in it."""
    path, _ = written
    data = path.read_bytes()
    with zipfile.ZipFile(path) as archive:
        infos = archive.infolist()
    assert infos[0].filename == "default.usda"
    for info in infos:
        name, extra = (int.from_bytes(data[info.header_offset + at :][:2], "little") for at in (26, 28))
        assert (info.header_offset + 30 + name + extra) % 64 == 0
        assert (info.compress_type, info.date_time[0]) == (zipfile.ZIP_STORED, 1980)


def test_openusd_opens_the_stage(written):
    usd = pytest.importorskip("pxr.Usd")
    stage = usd.Stage.Open(str(written[0]))
    assert stage.GetDefaultPrim().GetAttribute("sceneIndex").Get().path == "./scene.json"


def test_equal_scenes_give_equal_files(written, tmp_path):
    path, scene = written
    (tmp_path / "other").mkdir()
    save_scene(tmp_path / "other" / NAME, scene)
    assert (tmp_path / "other" / NAME).read_bytes() == path.read_bytes()


def test_a_bundle_by_any_name_of_usdz_opens(written):
    other = rewrite(written[0], {})
    assert find_format(other).suffix == ".usdz"
    assert len(open_scene(other)) == len(written[1])


def test_every_third_splat_opens(written):
    whole, part = open_scene(written[0]), open_scene(written[0], keep_every=3)
    np.testing.assert_array_equal(part.gaussians.means, whole.gaussians.means[::3])


def test_version_2_lists_no_chunks(written):
    def downgrade(scene):
        scene["schema"] = "splatsim.scene/v2"
        del scene["gaussians"]["chunks"]

    found = open_scene(rewrite(written[0], {"scene.json": downgrade}))
    assert len(found) == len(written[1])


def test_one_body_on_two_tracks_is_two_instances(tmp_path):
    """A bundle by other hands: one sedan, two tracks, one of them with a box twice as long, one without a body."""
    cloud = random_scene(1, 30, actors=0).gaussians
    bare = replace(cloud, features=np.zeros((30, 0), np.float32))
    file = BytesIO()
    encode_spz(file, tmp_path, bare, axes=RDF)
    frame = {"translation": [10.0, 0, 1], "rotation": [0, 0, 0, 1.0]}
    frames = [{"timestamp_us": 5_000_000 + 100_000 * step, **frame} for step in range(3)]
    frames[2] = {**frames[2], "translation": [14.0, 0, 1]}
    tracks = [
        {"track_id": name, "class_name": "automobile", "size": [length, 2, 1.5], "frames": frames}
        for name, length in (("100", 4.0), ("101", 8.0), ("102", 4.0))
    ]
    asset = {
        "asset_id": "sedan",
        "uri": "actor_assets/sedan/asset.spz",
        "class_name": "automobile",
        "motion": "rigid",
        "size": [4.0, 2, 1.5],
        "n_points": 30,
    }
    fits = [("100", "rigid"), ("101", "stretch")]
    documents = {
        "scene.json": {
            "schema": "splatsim.scene/v3",
            "world": {"frame_convention": FRAMES, "ecef_anchor": np.diag([1, -1, -1, 1.0]).tolist()},
            "gaussians": {"frame": "world", "chunks": [{"uri": "chunks/a.spz", "n_points": 30}]},
            "extras": {"map_lanelet2": "map.osm", "ppisp": None},
        },
        "sequence_tracks.json": {
            "schema": "splatsim.sequence_tracks/v2",
            "frame": "world",
            "frame_convention": FRAMES,
            "tracks": tracks,
        },
        "actor_assets.json": {
            "schema": "splatsim.actor_assets/v1",
            "frame": "object",
            "object_frame": OBJECT_FRAME,
            "assets": [asset],
            "instances": [{"track_id": name, "asset_id": "sedan", "fit_mode": fit} for name, fit in fits],
        },
    }
    with zipfile.ZipFile(tmp_path / "drive.usdz", "w") as archive:
        for name, document in documents.items():
            archive.writestr(name, json.dumps(document))
        for name in ("chunks/a.spz", asset["uri"]):
            archive.writestr(name, file.getvalue())
    found = open_scene(tmp_path / "drive.usdz")
    assert np.bincount(found.nodes).tolist() == [30, 30, 30]
    assert [(each.id, each.name, each.class_name) for each in found.table] == [
        (1, "100", "automobile"),
        (2, "101", "automobile"),
    ]
    first, second = (found.gaussians.means[found.nodes == node] @ BOX_FROM_FORWARD_X for node in (1, 2))
    np.testing.assert_allclose(second, first * [2, 1, 1], atol=1e-5)
    assert found.actors[0].times.tolist() == pytest.approx([0, 0.1, 0.2])
    assert found.actors[0].moving
    assert sorted(found.left_out) == [
        "1 track without splats of its own",
        "its place on Earth (ecef_anchor)",
        "map_lanelet2 (map.osm)",
    ]


WRONG = {
    "an older schema": ({"scene.json": lambda doc: doc.update(schema="splatsim.scene/v1")}, "schema"),
    "another frame": (
        {"scene.json": lambda doc: doc["world"]["frame_convention"].update(quaternion_order="wxyz")},
        "frame",
    ),
    "a chunk outside": ({"scene.json": lambda doc: doc["gaussians"]["chunks"][0].update(uri="../a.spz")}, "leads out"),
    "a missing chunk": ({"scene.json": lambda doc: doc["gaussians"]["chunks"][0].update(uri="chunks/z.spz")}, "z.spz"),
    "another count": ({"scene.json": lambda doc: doc["gaussians"]["chunks"][0].update(n_points=3)}, "3 are listed"),
    "too many": ({"scene.json": lambda doc: doc["gaussians"]["chunks"][0].update(n_points=10**9)}, "splats"),
    "a deforming body": ({"actor_assets.json": lambda doc: doc["assets"][0].update(motion="smpl")}, "motion"),
    "a body without size": ({"actor_assets.json": lambda doc: doc["assets"][0].update(size=[0, 1, 1])}, "size"),
    "a track bound twice": (
        {"actor_assets.json": lambda doc: doc["instances"].append(doc["instances"][0])},
        "twice",
    ),
    "stamps that fall": ({"sequence_tracks.json": lambda doc: doc["tracks"][0]["frames"].reverse()}, "do not rise"),
    "no rotation": (
        {"sequence_tracks.json": lambda doc: doc["tracks"][0]["frames"][0].update(rotation=[0, 0, 0, 0])},
        "rotation",
    ),
    "no JSON": ({"scene.json": b"{"}, "no JSON"),
    "a list": ({"sequence_tracks.json": b"[]"}, "not an object"),
    "a damaged body": ({"actor_assets.json": lambda doc: doc["assets"][0].update(uri="scene.json")}, "begins with"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_bundles_are_refused_by_name(written, case):
    changes, words = WRONG[case]
    path = rewrite(written[0], changes)
    with pytest.raises((DataError, UntrustedDataError), match=words) as caught:
        open_scene(path)
    assert str(path) in str(caught.value)


def test_a_compressed_bundle_is_refused(written):
    """USDZ stores its members; a bomb of equal letters is never unfolded."""
    members = read_members(written[0]) | {"map.osm": b" " * (64 << 20)}
    path = written[0].with_name("bomb.usdz")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    with pytest.raises(DataError, match="compressed"):
        open_scene(path)
