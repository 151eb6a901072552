"""Opens a data set with nuscenes-devkit, in an environment without this program, for `benchmarks.devkits`."""

import contextlib
import importlib
import importlib.metadata
import io
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

# Named at run time: the packages are in another environment than that in which this file is checked.
NuScenes: Any = importlib.import_module("nuscenes.nuscenes").NuScenes
verify_setup: Any = importlib.import_module("nuscenes.tests.assert_download").verify_setup
data_classes: Any = importlib.import_module("nuscenes.utils.data_classes")
points_in_box: Any = importlib.import_module("nuscenes.utils.geometry_utils").points_in_box


def check_chains(tables: Any) -> None:
    """Follow all links forward: samples of the scene, data of each sensor, annotations of each instance."""
    scene = tables.scene[0]
    walked, token, last, previous = 0, scene["first_sample_token"], -1, ""
    while token:
        sample = tables.get("sample", token)
        assert sample["timestamp"] > last, "the times of samples do not rise"
        walked, last, previous, token = walked + 1, sample["timestamp"], token, sample["next"]
    assert walked == scene["nbr_samples"] == len(tables.sample), "samples are missing from the chain"
    assert previous == scene["last_sample_token"], "the chain ends elsewhere"
    for instance in tables.instance:
        walked, token, previous = 0, instance["first_annotation_token"], ""
        while token:
            record = tables.get("sample_annotation", token)
            assert record["instance_token"] == instance["token"], "an annotation belongs to another instance"
            walked, previous, token = walked + 1, token, record["next"]
        assert (walked, previous) == (instance["nbr_annotations"], instance["last_annotation_token"]), "chain of boxes"
    for row in tables.sample_data:
        if row["next"]:
            assert tables.get("sample_data", row["next"])["prev"] == row["token"], "links of data do not fit"


def compare_boxes(tables: Any, recording: Path) -> tuple[int, float]:
    """Count of boxes, and the largest difference to the recording's own in metres."""
    manifest = json.loads((recording / "recording.json").read_text())
    worst, count = 0.0, 0
    for sample, moment in zip(tables.sample, manifest["moments"], strict=True):
        own = {str(box["id"]): box for box in json.loads((recording / moment["file"]).read_text())["boxes"]}
        for token in sample["anns"]:
            box, record = tables.get_box(token), tables.get("sample_annotation", token)
            name = tables.get("instance", record["instance_token"])["instance_name"]
            expected = np.array(own[name]["center"]) + manifest["origin"]
            size = [own[name]["size"][side] for side in ("width", "length", "height")]
            worst = max(worst, float(np.abs(box.center - expected).max()), float(np.abs(box.wlh - size).max()))
            assert np.isfinite(tables.box_velocity(token)).all() or not (record["prev"] or record["next"]), "velocity"
            count += 1
    return count, worst


def count_points(tables: Any) -> int:
    """Largest difference between the points in boxes that the devkit counts and the written numbers."""
    worst = 0
    for sample in tables.sample:
        path, boxes, _ = tables.get_sample_data(sample["data"]["LIDAR_TOP"])
        points = data_classes.LidarPointCloud.from_file(path).points[:3]
        for box in boxes:
            written = tables.get("sample_annotation", box.token)["num_lidar_pts"]
            worst = max(worst, abs(int(points_in_box(box, points).sum()) - written))
    return worst


def project(tables: Any) -> float:
    """Share of photos into which points of the sample's sweep fall, by the devkit's own transforms."""
    hit, photos = 0, 0
    for sample in tables.sample[:2]:
        for channel, token in sample["data"].items():
            if channel.startswith("CAM"):
                path, _, intrinsic = tables.get_sample_data(token)
                assert Path(path).is_file()
                assert np.asarray(intrinsic).shape == (3, 3)
                points, _, _ = tables.explorer.map_pointcloud_to_image(sample["data"]["LIDAR_TOP"], token)
                hit, photos = hit + (points.shape[1] > 0), photos + 1
    return hit / max(photos, 1)


def main(folder: str, recording: str) -> None:
    """Open, check, print."""
    problems: list[str] = []
    found: dict[str, Any] = {"devkit": importlib.metadata.version("nuscenes-devkit")}
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        tables = NuScenes("v1.0-mini", dataroot=folder, verbose=True)
        found["tables"] = len(tables.table_names)
        for check in (verify_setup, check_chains):
            try:
                check(tables)
            except AssertionError as error:
                problems.append(f"{check.__name__}: {error}")
        found["boxes"], found["box_m"] = compare_boxes(tables, Path(recording))
        found["points_in_boxes"], found["projected"] = count_points(tables), project(tables)
        tables.list_scenes()
        tables.list_sample(tables.sample[0]["token"])
    print(json.dumps(found | {"problems": problems}))


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])
