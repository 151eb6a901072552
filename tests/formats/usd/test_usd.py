"""USD: what the schema defines, tracks over time, stages of other programs, and those that must be refused."""

import dataclasses
import zipfile

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdValidation, Vt
from random_scene import random_scene

from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.extras import MissingExtraError
from instdrive_core.formats.registry import open_scene, save_scene
from instdrive_core.formats.usd import stage
from instdrive_core.formats.usd.writing import order_by_prim
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.maths.spherical_harmonics import evaluate_view_colors

SPLATS = "ParticleField3DGaussianSplat"
ENDINGS = [".usda", ".usdc", ".usd", ".usdz"]


def street(count=120, actors=0, **options):
    return dataclasses.replace(random_scene(2, count, actors=actors, **options), sky=None, views=())


@pytest.mark.parametrize("ending", ENDINGS)
def test_instances_and_tracks_come_back(tmp_path, ending):
    scene = street(actors=2)
    save_scene(tmp_path / f"a{ending}", scene)
    found, order = open_scene(tmp_path / f"a{ending}"), order_by_prim(scene)
    np.testing.assert_array_equal(found.gaussians.means, scene.gaussians.means[order])
    np.testing.assert_array_equal(found.gaussians.sh_rest, scene.gaussians.sh_rest[order])
    np.testing.assert_allclose(found.gaussians.log_scales, scene.gaussians.log_scales[order], atol=1e-5)
    np.testing.assert_allclose(found.gaussians.quats, normalize_quaternions(scene.gaussians.quats[order]), atol=1e-6)
    thing = found.instance_ids > 0
    np.testing.assert_array_equal(found.codewords[thing], scene.codewords[order][thing])
    for name in ("instance_ids", "nodes"):
        np.testing.assert_array_equal(getattr(found, name), getattr(scene, name)[order], err_msg=name)
    assert list(found.table) == list(scene.table)
    assert (found.code_bits, found.antialiased) == (scene.code_bits, scene.antialiased)
    np.testing.assert_array_equal(found.origin, scene.origin)
    for mine, theirs in zip(scene.actors, found.actors, strict=True):
        assert (mine.id, mine.label, mine.moving) == (theirs.id, theirs.label, theirs.moving)
        np.testing.assert_array_equal(mine.dimensions, theirs.dimensions)
        np.testing.assert_allclose(mine.times, theirs.times, atol=1e-12)
        np.testing.assert_allclose(mine.world_from_box, theirs.world_from_box, atol=1e-9)


def test_a_package_does_not_tell_when_it_was_written(tmp_path):
    """One scene gives one file, whatever the clock says."""
    save_scene(tmp_path / "a.usdz", street())
    with zipfile.ZipFile(tmp_path / "a.usdz") as package:
        assert [part.date_time[0] for part in package.infolist()] == [1980]


def test_the_stage_is_as_the_schema_wants_it(tmp_path):
    scene = street(actors=1)
    save_scene(tmp_path / "a.usdz", scene)
    opened = Usd.Stage.Open(str(tmp_path / "a.usdz"))
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(opened)
    assert [error.GetMessage() for error in errors] == []
    assert (UsdGeom.GetStageUpAxis(opened), UsdGeom.GetStageMetersPerUnit(opened)) == ("Z", 1.0)
    prims = [prim for prim in opened.Traverse() if prim.GetTypeName() == SPLATS]
    rows = sum(len(prim.GetAttribute("positions").Get()) for prim in prims)
    assert rows == len(scene)
    degree = scene.gaussians.sh_degree
    for prim in prims:
        assert prim.GetAttribute("radiance:sphericalHarmonicsDegree").Get() == degree
        coefficients = prim.GetAttribute("radiance:sphericalHarmonicsCoefficients").Get()
        assert len(coefficients) == len(prim.GetAttribute("positions").Get()) * (degree + 1) ** 2
        low, high = np.array(prim.GetAttribute("extent").Get())
        positions = np.array(prim.GetAttribute("positions").Get())
        assert (positions > low).all()
        assert (positions < high).all()
    one = next(prim for prim in prims if prim.GetCustomDataByKey("instdrive")["id"] == 1)
    mine = scene.instance_ids == 1
    quat = one.GetAttribute("orientations").Get()[0]
    expected = normalize_quaternions(scene.gaussians.quats[mine])[0]
    np.testing.assert_allclose([quat.GetReal(), *quat.GetImaginary()], expected, atol=1e-6)
    np.testing.assert_allclose(
        one.GetAttribute("scales").Get()[0], np.exp(scene.gaussians.log_scales[mine][0]), rtol=1e-5
    )


def test_another_program_sees_the_car_where_its_track_has_it(tmp_path):
    scene = street(actors=1)
    save_scene(tmp_path / "a.usdc", scene)
    opened, (track,) = Usd.Stage.Open(str(tmp_path / "a.usdc")), scene.actors
    prim = next(prim for prim in opened.Traverse() if prim.GetTypeName() == SPLATS and "Car" in str(prim.GetPath()))
    for time in (track.times[0], 0.5 * (track.times[1] + track.times[2]), track.times[-1]):
        matrix = UsdGeom.XformCache(10 * time).GetLocalToWorldTransform(prim)
        np.testing.assert_allclose(np.array(matrix).T, track.interpolate_pose(time), atol=1e-6)
        assert UsdGeom.Imageable(prim).ComputeVisibility(10 * time) == "inherited"
    for time in (track.times[0] - 0.2, track.times[-1] + 0.2):
        assert UsdGeom.Imageable(prim).ComputeVisibility(10 * time) == "invisible"


def foreign_stage(path, count=6, up="Y", units=0.01, extra=None):
    """A stage as other programs write them: y up, centimetres, halves, no word of instances."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, units)
    stage.SetTimeCodesPerSecond(24)
    carrier = UsdGeom.Xform.Define(stage, "/World/Cart")
    rng = np.random.default_rng(0)
    for name in ("Wheel", "Body"):
        prim = stage.DefinePrim(f"/World/Cart/{name}", SPLATS)
        prim.GetAttribute("positionsh").Set(Vt.Vec3hArray([Gf.Vec3h(*row) for row in rng.normal(0, 50, (count, 3))]))
        prim.GetAttribute("scalesh").Set(Vt.Vec3hArray([Gf.Vec3h(*row) for row in rng.uniform(1, 9, (count, 3))]))
        prim.GetAttribute("opacities").Set(Vt.FloatArray([0.5] * (count - 1)))  # one too short: not there
        prim.GetAttribute("radiance:sphericalHarmonicsDegree").Set(1)
        coefficients = rng.normal(size=(4 * count + 5, 3))  # too long: cut
        values = Vt.Vec3fArray.FromNumpy(coefficients.astype(np.float32))
        prim.GetAttribute("radiance:sphericalHarmonicsCoefficients").Set(values)
    if extra is not None:
        extra(stage, carrier)
    stage.Save()
    return stage


def test_foreign_stages_become_upright_metres_with_an_instance_for_each_prim(tmp_path):
    stage = foreign_stage(tmp_path / "a.usda")
    scene = open_scene(tmp_path / "a.usda")
    assert [entry.name for entry in scene.table] == ["Wheel", "Body"]
    x, y, z = np.array(stage.GetPrimAtPath("/World/Cart/Body").GetAttribute("positionsh").Get(), float).T
    np.testing.assert_allclose(scene.gaussians.means[6:], np.c_[x, -z, y] / 100, rtol=1e-5)
    sizes = np.array(stage.GetPrimAtPath("/World/Cart/Body").GetAttribute("scalesh").Get(), float)
    np.testing.assert_allclose(np.exp(scene.gaussians.log_scales[6:]), sizes / 100, rtol=1e-4)
    assert (scene.gaussians.opacity_logits > 13).all()  # the schema: what is too short is passed over, and 1 taken
    assert any("opacities" in sentence for sentence in scene.left_out)
    stored = np.array(
        stage.GetPrimAtPath("/World/Cart/Body").GetAttribute("radiance:sphericalHarmonicsCoefficients").Get()
    )[:24].reshape(6, 4, 3)
    directions = np.eye(3, dtype=np.float32)[[0, 1, 2, 0, 1, 2]]
    before = evaluate_view_colors(stored[:, 0], stored[:, 1:], directions)
    turned = np.c_[directions[:, 0], -directions[:, 2], directions[:, 1]]
    after = evaluate_view_colors(scene.gaussians.sh_dc[6:], scene.gaussians.sh_rest[6:], turned)
    np.testing.assert_allclose(after, before, atol=1e-5)


def test_what_another_program_animates_is_a_track(tmp_path):
    def drive(stage, carrier):
        move, turn, scale = carrier.AddTranslateOp(), carrier.AddRotateZOp(), carrier.AddScaleOp()
        scale.Set(Gf.Vec3f(2, 2, 2))
        for code in (0, 12, 24):
            move.Set(Gf.Vec3d(code, 0, 0), code)
            turn.Set(3.0 * code, code)

    foreign_stage(tmp_path / "a.usda", up="Z", units=1.0, extra=drive)
    scene = open_scene(tmp_path / "a.usda")
    (track,) = scene.actors
    assert (track.id, track.label) == ("World/Cart", "object")
    np.testing.assert_allclose(track.times, [0, 0.5, 1])
    np.testing.assert_allclose(track.world_from_box[:, 0, 3], [0, 12, 24], atol=1e-9)
    np.testing.assert_allclose(track.world_from_box[1, :2, 0], [np.cos(np.pi / 5), np.sin(np.pi / 5)], atol=1e-6)
    assert (scene.nodes == 1).all()
    opened = Usd.Stage.Open(str(tmp_path / "a.usda"))
    stored = np.array(opened.GetPrimAtPath("/World/Cart/Wheel").GetAttribute("positionsh").Get(), np.float32)
    np.testing.assert_allclose(scene.gaussians.means[:6], 2 * stored, rtol=1e-5)


def grow(stage, carrier):
    scale = carrier.AddScaleOp()
    for code in (0, 10):
        scale.Set(Gf.Vec3f(1 + code, 1 + code, 1 + code), code)


def mirror(stage, carrier):
    carrier.AddScaleOp().Set(Gf.Vec3f(-1, 1, 1))


def make_opaque(stage, carrier):
    stage.GetPrimAtPath("/World/Cart/Body").GetAttribute("opacities").Set(Vt.FloatArray([2.0] * 6))


def hide(stage, carrier):
    UsdGeom.Imageable(carrier).MakeInvisible()


@pytest.mark.parametrize(
    ("extra", "said"),
    [
        (grow, "grows over time"),
        (mirror, "mirrored"),
        (make_opaque, "opacity of splat 0 of /World/Cart/Body is 2"),
        (hide, "no prim of its stage holds splats"),
    ],
)
def test_what_splats_cannot_follow_is_refused(tmp_path, extra, said):
    foreign_stage(tmp_path / "a.usda", extra=extra)
    with pytest.raises(DataError, match=said):
        open_scene(tmp_path / "a.usda")


def test_files_beside_it_are_read_and_others_refused(tmp_path):
    (tmp_path / "inside").mkdir()
    foreign_stage(tmp_path / "inside" / "cart.usda")
    foreign_stage(tmp_path / "outside.usda")

    def stack(name, below):
        layer = Sdf.Layer.CreateNew(str(tmp_path / "inside" / name))
        layer.subLayerPaths.append(below)
        layer.Save()
        return tmp_path / "inside" / name

    assert len(open_scene(stack("good.usda", "./cart.usda"))) == 12
    with pytest.raises(UntrustedDataError, match="outside of its folder"):
        open_scene(stack("bad.usda", "../outside.usda"))
    with pytest.raises(UntrustedDataError, match="outside of its folder"):
        open_scene(stack("remote.usda", "https://example.com/a.usda"))
    with pytest.raises(DataError, match=r"gone\.usda.*which is missing"):
        open_scene(stack("poor.usda", "./gone.usda"))


def test_values_in_clips_are_refused(tmp_path):
    def clip(stage, carrier):
        Usd.ClipsAPI(carrier.GetPrim()).SetClipAssetPaths([Sdf.AssetPath("./clip.usda")])

    foreign_stage(tmp_path / "a.usda", extra=clip)
    with pytest.raises(DataError, match="takes values from clips"):
        open_scene(tmp_path / "a.usda")


def test_without_the_extra_its_name_is_told(tmp_path, monkeypatch):
    path = tmp_path / "a.usda"
    save_scene(path, street(10))

    def miss(name):
        raise ModuleNotFoundError(name=name)

    monkeypatch.setattr(stage, "import_module", miss)
    for act in (lambda: open_scene(path), lambda: save_scene(path, street(10))):
        with pytest.raises(MissingExtraError, match=r"pip install 'instdrive\[usd\]'"):
            act()


def test_a_file_that_is_none_is_refused(tmp_path):
    path = tmp_path / "a.usda"
    path.write_text("hello")
    with pytest.raises(DataError, match="not as a USD file does"):
        open_scene(path)
    path.write_text('#usda 1.0\ndef "x" {')
    with pytest.raises(DataError, match="is no readable USD file"):
        open_scene(path)
