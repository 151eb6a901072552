"""ID masks of a scene's cameras: exact as PNG, and by the rules of COCO's panoptic format."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from random_scene import random_scene

from instdrive_app.main import main
from instdrive_core.errors import DataError, OptionError
from instdrive_core.formats.folder.scenes import write_scene_folder
from instdrive_core.instances.colormap import ids_from_colors
from instdrive_core.instances.table import build_instance_table
from instdrive_core.masks.export.coco_panoptic import measure_segments, write_coco_panoptic
from instdrive_core.masks.export.id_maps import choose_views, render_id_maps
from instdrive_core.masks.export.id_pictures import write_id_pictures
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene


@pytest.fixture
def scene():
    """Large, opaque splats of eight instances, two of them moving, seen by five cameras."""
    scene = random_scene(count=300, actors=2)
    scene.gaussians.log_scales[:] = np.log(0.5)
    scene.gaussians.opacity_logits[:] = 4
    scene.table = build_instance_table(
        scene.instance_ids,
        scene.gaussians.means,
        scene.codewords,
        scene.nodes,
        classes={1: "Car", 2: "Road", 3: "Car", 4: "Vegetation", 7: "Pedestrian"},
    )
    return scene


def truth(scene, view, scale=1.0):
    return build_instance_map(scene, view_scene(scene, view.camera.scale(scale), view.time))


def picture(path):
    with Image.open(path) as image:
        return np.asarray(image)


def panoptic_problems(folder):
    """What breaks the format's rules, checked as its evaluation code reads it."""
    content = json.loads((folder / "panoptic.json").read_text(encoding="utf-8"))
    categories = {entry["id"]: entry for entry in content["categories"]}
    images = {entry["id"]: entry for entry in content["images"]}
    problems = []
    if len(images) != len(content["images"]) or len(categories) != len(content["categories"]):
        problems.append("IDs repeat")
    if [entry["image_id"] for entry in content["annotations"]] != list(images):
        problems.append("images and annotations differ")
    for annotation in content["annotations"]:
        pixels = picture(folder / "panoptic" / annotation["file_name"])
        image = images[annotation["image_id"]]
        if pixels.dtype != np.uint8 or pixels.shape != (image["height"], image["width"], 3):
            problems.append("the picture is of another kind or size")
        ids = pixels.astype(np.int64) @ [1, 256, 65536]
        segments = {segment["id"]: segment for segment in annotation["segments_info"]}
        if len(segments) != len(annotation["segments_info"]):
            problems.append("segments repeat")
        if set(segments) != set(np.unique(ids).tolist()) - {0}:
            problems.append("segments and pixels differ")
            continue
        for number, segment in segments.items():
            rows, columns = np.nonzero(ids == number)
            box = [columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1]
            right = (len(rows), box, 0, True)
            told = (segment["area"], segment["bbox"], segment["iscrowd"], segment["category_id"] in categories)
            if told != right:
                problems.append(f"segment {number} is {right}, not {told}")
    return problems


def test_png_pictures_hold_exact_ids(scene, tmp_path):
    views = choose_views(scene)
    assert write_id_pictures(tmp_path, scene, render_id_maps(scene, views)) == 5
    shown = set()
    for view in views:
        expected = truth(scene, view)
        labels = picture(tmp_path / "labels" / "front_camera" / f"{view.index:02d}.png")
        assert labels.dtype == np.uint16
        np.testing.assert_array_equal(labels, expected)
        colors = picture(tmp_path / "colors" / "front_camera" / f"{view.index:02d}.png")
        np.testing.assert_array_equal(ids_from_colors(colors), expected)
        shown |= set(np.unique(expected).tolist())
    assert len(shown) > 5
    listing = json.loads((tmp_path / "instances.json").read_text(encoding="utf-8"))
    assert {entry["id"] for entry in listing["instances"]} == set(scene.table.instances)
    assert [entry["key"] for entry in listing["frames"]] == [f"front_camera/{index:02d}" for index in range(5)]
    assert [entry["held_out"] for entry in listing["frames"]] == [False] * 4 + [True]


def test_ids_above_16_bits_are_packed(scene, tmp_path):
    scene.instance_ids[scene.instance_ids == 1] = 0xFEDCBA
    scene.table = build_instance_table(scene.instance_ids, scene.gaussians.means)
    views = choose_views(scene)[:1]
    write_id_pictures(tmp_path, scene, render_id_maps(scene, views))
    labels = picture(tmp_path / "labels" / "front_camera" / "00.png").astype(np.uint32)
    np.testing.assert_array_equal(labels @ np.uint32([1, 256, 65536]), truth(scene, views[0]))
    assert 0xFEDCBA in labels @ np.uint32([1, 256, 65536])
    assert "RGB" in json.loads((tmp_path / "instances.json").read_text())["labels"]


def test_coco_panoptic_keeps_the_rules(scene, tmp_path):
    write_coco_panoptic(tmp_path, scene, render_id_maps(scene, choose_views(scene), 2.0))
    assert panoptic_problems(tmp_path) == []
    content = json.loads((tmp_path / "panoptic.json").read_text(encoding="utf-8"))
    things = {entry["name"]: entry["isthing"] for entry in content["categories"]}
    assert {"id", "name", "supercategory", "isthing", "color"} == set(content["categories"][0])
    assert len({tuple(entry["color"]) for entry in content["categories"]}) == len(content["categories"])
    assert things == {"Car": 1, "Pedestrian": 1, "Road": 0, "Vegetation": 0, "object": 1}
    name_of = {entry["id"]: entry["name"] for entry in content["categories"]}
    for annotation, view in zip(content["annotations"], scene.views, strict=True):
        pixels = picture(tmp_path / "panoptic" / annotation["file_name"]).astype(np.uint32)
        np.testing.assert_array_equal(pixels @ np.uint32([1, 256, 65536]), truth(scene, view, 2.0))
        for segment in annotation["segments_info"]:
            class_name = scene.table[segment["id"]].class_name
            assert name_of[segment["category_id"]] == (class_name or "object")
    first = content["images"][0]
    assert (first["file_name"], first["width"], first["height"]) == ("00.jpg", 128, 96)


def test_the_rules_are_really_checked(scene, tmp_path):
    write_coco_panoptic(tmp_path, scene, render_id_maps(scene, choose_views(scene)))
    listing = tmp_path / "panoptic.json"
    content = json.loads(listing.read_text(encoding="utf-8"))
    content["annotations"][0]["segments_info"][0]["area"] += 1
    content["annotations"][1]["segments_info"].pop()
    listing.write_text(json.dumps(content), encoding="utf-8")
    assert len(panoptic_problems(tmp_path)) == 2


def test_segments_of_a_map():
    ids = np.zeros((4, 6), np.uint32)
    assert measure_segments(ids) == []
    ids[1:3, 2:5] = 70000
    ids[0, 0] = ids[3, 5] = 9
    assert measure_segments(ids) == [
        {"id": 9, "area": 2, "bbox": [0, 0, 6, 4]},
        {"id": 70000, "area": 6, "bbox": [2, 1, 3, 2]},
    ]


def test_an_interrupted_export_is_not_taken_for_a_whole_one(scene, tmp_path):
    maps = list(render_id_maps(scene, choose_views(scene)))
    for write, listing in ((write_id_pictures, "instances.json"), (write_coco_panoptic, "panoptic.json")):
        write(tmp_path, scene, maps)
        assert (tmp_path / listing).exists()

        def stop(done):
            if done == 2:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            write(tmp_path, scene, maps, stop)
        assert not (tmp_path / listing).exists()


def test_views_are_chosen(scene):
    assert [view.index for view in choose_views(scene, "front_camera", 2)] == [0, 2, 4]
    with pytest.raises(OptionError, match="it has front_camera"):
        choose_views(scene, "back_camera")
    with pytest.raises(OptionError, match="whole number"):
        choose_views(scene, None, 0)
    for scale in (0.0, -1.0, np.nan, 1e6):
        with pytest.raises(OptionError, match="scale"):
            next(render_id_maps(scene, choose_views(scene), scale))
    scene.views = ()
    with pytest.raises(OptionError, match="no photo cameras"):
        choose_views(scene)


def test_names_from_files_lead_nowhere(scene):
    scene.views = tuple(replace(view, name="../../etc") for view in scene.views)
    with pytest.raises(OptionError, match="cannot be a folder"):
        choose_views(scene)


@pytest.mark.parametrize(("form", "listing"), [("png", "instances.json"), ("coco", "panoptic.json")])
def test_the_command(scene, tmp_path, capsys, form, listing):
    write_scene_folder(tmp_path / "scene", scene)
    arguments = ["id-masks", str(tmp_path / "scene"), "-o", str(tmp_path / "out"), "--format", form, "--every", "2"]
    assert main([*arguments, "--camera", "front_camera", "--scale", "0.5"]) == 0
    assert "masks of 3 photos, 8 instances" in capsys.readouterr().out
    assert (tmp_path / "out" / listing).exists()
    (tmp_path / "file").touch()
    assert main(["id-masks", str(tmp_path / "scene"), "-o", str(tmp_path / "file")]) == 2
    assert "is a file" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written(scene, tmp_path):
    (tmp_path / "labels").touch()
    with pytest.raises(DataError, match="cannot be written"):
        write_id_pictures(tmp_path, scene, render_id_maps(scene, choose_views(scene)))
    (tmp_path / "panoptic.json").mkdir()
    with pytest.raises(DataError, match="cannot be replaced"):
        write_coco_panoptic(tmp_path, scene, render_id_maps(scene, choose_views(scene)))
