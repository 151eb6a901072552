"""Checkpoints of other trainers open as scenes: values, actors, tracks and sky where they belong."""

import json

import numpy as np
import pytest

from instdrive_core.cli.convert import convert
from instdrive_core.cli.info import print_info
from instdrive_core.edits.queries.bake import freeze_at_time
from instdrive_core.errors import DataError
from instdrive_core.formats.actors.sample_files import write_street_tracks
from instdrive_core.formats.checkpoints.sample_files import (
    build_captured_content,
    build_drivestudio_content,
    build_gsplat_content,
    build_hugsim_content,
    build_splatfacto_content,
    build_street_content,
    write_checkpoint,
)
from instdrive_core.formats.registry import open_scene
from instdrive_core.maths.activations import sigmoid
from instdrive_core.maths.rotations import matrix_from_quaternion
from instdrive_core.maths.spherical_harmonics import color_from_dc, evaluate_view_colors


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def assert_splats(gaussians, arrays, rows=slice(None)):
    """Values of `arrays` (by the checkpoint's names) are those of the Gaussians' rows."""
    for name, field in {"means": "means", "quats": "quats", "scales": "log_scales"}.items():
        np.testing.assert_array_equal(getattr(gaussians, field)[rows], arrays[name])


def test_gsplat(tmp_path, rng):
    content = build_gsplat_content(rng)
    scene = open_scene(write_checkpoint(tmp_path / "ckpt_6999_rank0.pt", content))
    assert_splats(scene.gaussians, content["splats"])
    np.testing.assert_array_equal(scene.gaussians.opacity_logits, content["splats"]["opacities"])
    np.testing.assert_array_equal(scene.gaussians.sh_dc, content["splats"]["sh0"][:, 0])
    np.testing.assert_array_equal(scene.gaussians.sh_rest, content["splats"]["shN"])
    assert scene.left_out == ()
    write_checkpoint(tmp_path / "ckpt_6999_rank1.pt", content)
    assert "ckpt_6999_rank1.pt" in open_scene(tmp_path / "ckpt_6999_rank0.pt").left_out[0]
    content["splats"] = {"means": content["splats"]["means"], "features": content["splats"]["quats"]}
    with pytest.raises(DataError, match=r"b\.pt: its colours come from a network \(app_opt\)"):
        open_scene(write_checkpoint(tmp_path / "b.pt", content))


@pytest.mark.parametrize("prefix", ["_model.gauss_params.", "_model.", "module._model.gauss_params."])
def test_splatfacto_stands_in_the_axes_of_the_data_set(tmp_path, rng, prefix):
    content = build_splatfacto_content(rng, prefix=prefix)
    path = write_checkpoint(tmp_path / "run" / "nerfstudio_models" / "step-000029999.ckpt", content)
    bare = open_scene(path)
    means = content["pipeline"][f"{prefix}means"]
    np.testing.assert_array_equal(bare.gaussians.means, means)
    assert any("dataparser_transforms.json" in sentence for sentence in bare.left_out)
    assert any("corrections of the cameras" in sentence for sentence in bare.left_out)

    angle, scale = 0.7, 0.05
    rotation = matrix_from_quaternion(np.array([np.cos(angle), np.sin(angle), 0, 0]))
    shift = np.array([1.0, -2, 3])
    fields = {"transform": np.c_[rotation, shift].tolist(), "scale": scale}
    (tmp_path / "run" / "dataparser_transforms.json").write_text(json.dumps(fields))
    (tmp_path / "run" / "config.yml").write_text("    rasterize_mode: antialiased\n")
    scene = open_scene(path)
    assert scene.antialiased
    # nerfstudio moves a place p of the data set to scale * (R p + t).
    np.testing.assert_allclose(scale * (scene.gaussians.means @ rotation.T + shift), means, atol=1e-5)
    np.testing.assert_allclose(
        scene.gaussians.log_scales, content["pipeline"][f"{prefix}scales"] - np.log(scale), atol=1e-5
    )
    direction = np.array([[0.6, 0.0, 0.8]], np.float32).repeat(len(means), 0)
    there = evaluate_view_colors(bare.gaussians.sh_dc, bare.gaussians.sh_rest, (direction @ rotation.T).astype("f4"))
    here = evaluate_view_colors(scene.gaussians.sh_dc, scene.gaussians.sh_rest, direction)
    np.testing.assert_allclose(here, there, atol=1e-4)

    (tmp_path / "run" / "dataparser_transforms.json").write_text(json.dumps(fields | {"scale": 0}))
    with pytest.raises(DataError, match=r"dataparser_transforms\.json: .*'scale' no positive number"):
        open_scene(path)


def test_splatfacto_without_sh_has_logits_of_colours(tmp_path, rng):
    content = build_splatfacto_content(rng)
    pipeline = content["pipeline"]
    pipeline["_model.gauss_params.features_rest"] = pipeline["_model.gauss_params.features_rest"][:, :0]
    scene = open_scene(write_checkpoint(tmp_path / "a.ckpt", content))
    colors = sigmoid(pipeline["_model.gauss_params.features_dc"])
    np.testing.assert_allclose(color_from_dc(scene.gaussians.sh_dc), colors, atol=1e-6)


def test_captured_tuples_of_inria_and_hugsim(tmp_path, rng):
    content = build_captured_content(rng)
    scene = open_scene(write_checkpoint(tmp_path / "chkpnt30000.pth", content))
    assert_splats(scene.gaussians, {"means": content[0][1], "scales": content[0][4], "quats": content[0][5]})
    content = build_hugsim_content(rng)
    scene = open_scene(write_checkpoint(tmp_path / "scene.pth", content))
    head, ground = content[0], content[0][-1]
    assert_splats(scene.gaussians, {"means": head[1], "scales": head[5], "quats": head[6]}, slice(0, 30))
    np.testing.assert_array_equal(scene.gaussians.means[30:], ground[1])
    np.testing.assert_allclose(scene.gaussians.log_scales[30:, 1], np.log(0.001))
    np.testing.assert_array_equal(scene.gaussians.log_scales[30:][:, [0, 2]], ground[5])
    assert any("semantic" in sentence for sentence in scene.left_out)


def test_drivestudios_cars_follow_their_tracks(tmp_path, rng):
    content = build_drivestudio_content(rng)
    path = write_checkpoint(tmp_path / "checkpoint_final.pth", content)
    scene = open_scene(path)
    rigid = content["models"]["RigidNodes"]
    assert [track.label for track in scene.actors] == ["vehicle", "vehicle", "deformable", "person"]
    assert [instance.count for instance in scene.table] == [12, 8, 10, 14]
    assert scene.actors[0].dimensions.tolist() == pytest.approx([1.9, 4.5, 1.5])  # width, length, height
    assert scene.actors[1].times.tolist() == pytest.approx([0.2, 0.3, 0.4])
    assert_splats(
        scene.gaussians,
        {"means": content["models"]["Background"]["_means"]}
        | {"quats": content["models"]["Background"]["_quats"]}
        | {"scales": content["models"]["Background"]["_scales"]},
        slice(0, 30),
    )
    for frame in (2, 4):
        still = freeze_at_time(scene, 0.1 * frame)
        owners = rigid["points_ids"][:, 0]
        turns = matrix_from_quaternion(rigid["instances_quats"][frame].astype(np.float64))
        means = np.einsum("nij,nj->ni", turns[owners], rigid["_means"]) + rigid["instances_trans"][frame][owners]
        np.testing.assert_allclose(still.gaussians.means[30:50], means, atol=1e-4)
        mine = matrix_from_quaternion(still.gaussians.quats[30:50].astype(np.float64))
        theirs = turns[owners] @ matrix_from_quaternion(rigid["_quats"].astype(np.float64))
        np.testing.assert_allclose(mine, theirs, atol=1e-5)
    # Colours are kept in the world's axes there; they are right in the frame of the shape.
    still = freeze_at_time(open_scene(path, time=0.3), 0.3)
    np.testing.assert_allclose(still.gaussians.sh_rest[30:50], rigid["_features_rest"], atol=1e-4)
    assert any(sentence.startswith("the network of exposures (Affine)") for sentence in scene.left_out)
    assert any(sentence.startswith("the motion of limbs of 1 SMPLNodes") for sentence in scene.left_out)


def test_drivestudios_deformable_things_have_the_shape_of_the_time_asked_for(tmp_path, rng):
    torch = pytest.importorskip("torch")
    content = build_drivestudio_content(rng)
    soft = {name: torch.tensor(value) for name, value in content["models"]["DeformableNodes"].items()}
    path = write_checkpoint(tmp_path / "checkpoint_final.pth", content)

    def waves(values):
        return torch.cat([values, *(f(values * k) for k in (1, 2) for f in (torch.sin, torch.cos))], dim=-1)

    for frame in (0, 3):
        points = waves(soft["_means"] / 1.7 * 2)
        time = waves(torch.full((10, 1), frame / 4))
        given = torch.cat([points, time, soft["instances_embedding"].expand(10, -1)], dim=-1)
        hidden = given
        for layer in range(4):
            weight, bias = (soft[f"deform_network.linear.{layer}.{name}"] for name in ("weight", "bias"))
            hidden = torch.relu(torch.nn.functional.linear(hidden, weight, bias))
            if layer == 2:
                hidden = torch.cat([given, hidden], dim=-1)
        warp, turn = (
            torch.nn.functional.linear(
                hidden, soft[f"deform_network.{name}.weight"], soft[f"deform_network.{name}.bias"]
            )
            for name in ("gaussian_warp", "gaussian_rotation")
        )
        rotation = matrix_from_quaternion(soft["instances_quats"][frame, 0].double().numpy())
        means = (soft["_means"] + warp).numpy() @ rotation.T + soft["instances_trans"][frame, 0].numpy()
        still = freeze_at_time(open_scene(path, time=0.1 * frame), 0.1 * frame)
        np.testing.assert_allclose(still.gaussians.means[still.instance_ids == 3], means, atol=1e-4)
        local = torch.nn.functional.normalize(soft["_quats"], dim=-1) + turn
        mine = matrix_from_quaternion(still.gaussians.quats[still.instance_ids == 3].astype(np.float64))
        np.testing.assert_allclose(mine, rotation @ matrix_from_quaternion(local.double().numpy()), atol=1e-4)


def test_drivestudios_people_are_skinned_at_the_time_asked_for(tmp_path, rng):
    torch = pytest.importorskip("torch")
    content = build_drivestudio_content(rng)
    person = content["models"]["SMPLNodes"]
    path = write_checkpoint(tmp_path / "checkpoint_final.pth", content)
    joints = person["template.J_canonical"][0].astype(np.float64)
    parents = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]
    grid = torch.tensor(person["template.voxel_deformer.lbs_voxel_base"])
    places = torch.tensor(person["_means"]) / 2
    places[:, 2] *= 2
    weights = (
        torch.nn.functional.grid_sample(
            grid, places[None, :, None, None], align_corners=True, padding_mode="border", mode="bilinear"
        )[0, :, :, 0, 0]
        .T.double()
        .numpy()
    )
    for frame in (1, 4):
        quats = np.concatenate([person["instances_quats"][frame, 0], person["smpl_qauts"][frame, 0]]).astype(np.float64)
        turns = matrix_from_quaternion(quats)
        world = []
        for joint, parent in enumerate(parents):
            here = np.eye(4)
            here[:3, :3] = turns[joint]
            here[:3, 3] = joints[joint] - (joints[parent] if parent >= 0 else 0)
            world.append(here if parent < 0 else world[parent] @ here)
        off = [np.block([[np.eye(3), -joints[j][:, None]], [np.zeros((1, 3)), 1]]) for j in range(24)]
        blended = np.einsum("nj,jab->nab", weights, np.stack([world[j] @ off[j] for j in range(24)]))
        means = np.einsum("nab,nb->na", blended[:, :3, :3], person["_means"]) + blended[:, :3, 3]
        means += person["instances_trans"][frame, 0]
        still = freeze_at_time(open_scene(path, time=0.1 * frame), 0.1 * frame)
        np.testing.assert_allclose(still.gaussians.means[still.instance_ids == 4], means, atol=1e-4)


def test_parts_of_people_that_are_missing_are_named(tmp_path, rng):
    content = build_drivestudio_content(rng)
    del content["models"]["SMPLNodes"]["template.voxel_deformer.lbs_voxel_base"]
    del content["models"]["DeformableNodes"]["deform_network.gaussian_warp.weight"]
    scene = open_scene(write_checkpoint(tmp_path / "a.pth", content))
    assert "how 1 of the SMPLNodes bend, as the grid of their skinning weights is missing" in scene.left_out
    assert any(sentence.startswith("how 1 of the DeformableNodes bend, as its network") for sentence in scene.left_out)


def test_the_sky_shows_what_the_cube_map_shows(tmp_path, rng):
    content = build_drivestudio_content(rng)
    faces = content["models"]["Sky"]["base"]
    sky = open_scene(write_checkpoint(tmp_path / "a.pth", content)).sky
    # OpenGL: on face +x (0) columns run along -z and rows along -y; drivestudio looks up (x, z, -y).
    for world, face, row, column in (
        ((1.0, -0.25, 0.25), 0, 1, 1),
        ((1.0, 0.75, -0.75), 0, 3, 3),
        ((0.25, 0.75, 1.0), 2, 0, 2),
        ((0.25, -1.0, 0.75), 4, 0, 2),
    ):
        x, y, z = world[0], world[2], -world[1]
        expected = faces[face, row, column]
        assert max(abs(x), abs(y), abs(z)) == 1
        np.testing.assert_allclose(sky.sample(np.array([world], np.float32))[0], expected, atol=1e-6)


def test_street_gaussians_takes_tracks_from_its_data_set(tmp_path, rng):
    content = build_street_content(rng)
    path = write_checkpoint(tmp_path / "run" / "trained_model" / "iteration_50000.pth", content)
    bare = open_scene(path)
    assert len(bare) == 42
    assert not bare.actors
    assert any(sentence.startswith("tracks of 1 moving objects, which lie in a row") for sentence in bare.left_out)
    write_street_tracks(tmp_path / "run")
    scene = open_scene(path, time=0.2)
    (track,) = scene.actors
    assert (track.id, track.label) == ("obj_007", "vehicle")
    assert track.dimensions.tolist() == [1.9, 4.5, 1.5]
    still = freeze_at_time(scene, 0.2)
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    # The car's places are around their mean: frame 2 of 0, 2, 4, 6 m stands at 1 m.
    means = content["obj_007"]["xyz"] @ turn.T + [1 + 8, 2, 0.5]
    np.testing.assert_allclose(still.gaussians.means[30:], means, atol=1e-4)
    np.testing.assert_allclose(still.gaussians.sh_rest[30:], content["obj_007"]["feature_rest"], atol=1e-4)
    share, series = 2 / 3, content["obj_007"]["feature_dc"]
    base = [
        1,
        np.sin(2 * np.pi * share),
        np.cos(2 * np.pi * share),
        np.sin(4 * np.pi * share),
        np.cos(4 * np.pi * share),
    ]
    np.testing.assert_allclose(scene.gaussians.sh_dc[30:], np.einsum("nfc,f->nc", series, base), atol=1e-5)
    (tmp_path / "run" / "track" / "track_info.txt").write_text("title\n0 7 vehicle -10 1.5 nonsense\n")
    with pytest.raises(DataError, match=r"track_info\.txt: line 2 is no box"):
        open_scene(path)


def test_every_kth_splat_of_nodes_keeps_its_actor(tmp_path, rng):
    path = write_checkpoint(tmp_path / "a.pth", build_drivestudio_content(rng))
    whole, third = open_scene(path), open_scene(path, keep_every=3)
    np.testing.assert_array_equal(third.nodes, whole.nodes[::3])
    # Products of matrices round by how many rows there are.
    np.testing.assert_allclose(third.gaussians.means, whole.gaussians.means[::3], atol=1e-6)


def test_what_is_no_scene_is_named(tmp_path, rng):
    with pytest.raises(DataError, match=r"a\.pth: it holds no scene that is known: a dictionary of 1 \('weights'\)"):
        open_scene(write_checkpoint(tmp_path / "a.pth", {"weights": np.zeros(3, np.float32)}))
    content = build_gsplat_content(rng)
    content["splats"]["scales"] = content["splats"]["scales"][:, :2]
    with pytest.raises(DataError, match="2D Gaussians"):
        open_scene(write_checkpoint(tmp_path / "b.pt", content))
    content = build_gsplat_content(rng)
    content["splats"]["quats"] = content["splats"]["quats"][:-1]
    with pytest.raises(DataError, match=r"'splats\.quats' is float32 of shape \(39, 4\), not floats of \(40, 4\)"):
        open_scene(write_checkpoint(tmp_path / "c.pt", content))
    content = build_drivestudio_content(rng)
    content["models"]["RigidNodes"]["points_ids"][0] = 2
    with pytest.raises(DataError, match="names an instance that is not there"):
        open_scene(write_checkpoint(tmp_path / "d.pth", content))


def test_info_and_convert_say_what_was_left_out(tmp_path, rng, capsys):
    path = write_checkpoint(tmp_path / "a.pth", build_drivestudio_content(rng))
    print_info(path)
    assert "left out:     the network of exposures (Affine)" in capsys.readouterr().out
    convert(path, tmp_path / "b.ply", time=0.1)
    assert "left out on opening: the network of exposures (Affine)" in capsys.readouterr().out
    assert open_scene(tmp_path / "b.ply").table[3].count == 10
