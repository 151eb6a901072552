"""Connected LiDAR as a control."""

from dataclasses import replace

import numpy as np
from evaluation_scene import DRIVING, PARKED, POLE, ROAD, box_surface
from test_protocol import FACTS

from instdrive_core.datasets.clip import Sweep, SweepPoints
from instdrive_core.evaluation.lidar_components import assign_component_ids
from instdrive_core.evaluation.protocol import evaluate_scene


def with_lidar(drive):
    """Every step's sweep: all surfaces, exactly labelled."""
    parked, driving = drive.clip.tracks
    x, y = np.meshgrid(np.arange(-8, 8, 0.15), np.arange(-5, 25, 0.15))
    road = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], -1)
    pole = np.stack([np.full(60, -3.0), np.full(60, 10.0), np.linspace(0, 4, 60)], -1)
    still = box_surface(parked.dimensions) + parked.world_from_box[0, :3, 3]

    def sweep(index):
        moving = box_surface(driving.dimensions) + driving.interpolate_pose(index / 10)[:3, 3]
        parts = {ROAD: road, PARKED: still, POLE: pole, DRIVING: moving}
        points = np.concatenate(list(parts.values())).astype(np.float32)
        labels = np.repeat(list(parts), [len(part) for part in parts.values()]).astype(np.uint32)
        zeros = np.zeros(len(points), np.float32)
        return Sweep(index, index / 10, lambda: SweepPoints(points, zeros, zeros.astype(np.uint8), None, labels))

    steps = sorted({frame.view.index for frame in drive.clip.frames})
    return replace(drive.clip, sweeps=tuple(sweep(index) for index in steps))


def test_what_stands_apart_is_apart(drive):
    ids = assign_component_ids(drive.scene, with_lidar(drive))
    assert ids is not None
    assert (ids > 0).all()
    heights, true_ids = drive.scene.gaussians.means[:, 2], drive.scene.instance_ids
    main = {}
    for label in (ROAD, PARKED, POLE):
        found, counts = np.unique(ids[(true_ids == label) & ((heights > 0.5) | (label == ROAD))], return_counts=True)
        assert counts.max() > 0.9 * counts.sum()
        main[label] = found[np.argmax(counts)]
    assert len(set(main.values())) == 3
    moving = np.unique(ids[drive.scene.nodes == 1])
    assert len(moving) == 1
    assert moving[0] not in main.values()


def test_no_lidar_no_control(drive):
    assert assign_component_ids(drive.scene, drive.clip) is None
    assert "LiDAR components" not in evaluate_scene(drive.scene, drive.clip, drive.truth, FACTS).controls


def test_held_out_sweeps_are_not_used(drive):
    clip = with_lidar(drive)
    held_out = replace(clip, sweeps=tuple(sweep for sweep in clip.sweeps if sweep.index in (4, 14)))
    assert assign_component_ids(drive.scene, held_out) is None


def test_whole_evaluation_with_lidar(drive):
    evaluation = evaluate_scene(drive.scene, with_lidar(drive), drive.truth, FACTS)
    lidar, components = evaluation.figures["lidar"], evaluation.controls["LiDAR components"]
    assert all(value is not None for value in lidar.values())
    assert lidar["ap50"] == 1
    assert lidar["reference_ap50"] >= 0.75, "the pole of the toy is thinner than its Gaussians"
    assert lidar["miou"] > 0.8
    assert lidar["vmeasure"] > 0.5 > evaluation.controls["random IDs"]["lidar"]["vmeasure"]
    assert lidar["instances_per_object"] == lidar["objects_per_instance"] == lidar["codes_per_object"] == 1
    assert components["lidar"]["ap50"] > 0.7
    assert components["scene"]["miou"] > 0.5
    assert evaluation.controls["one ID for all"]["lidar"]["objects_per_instance"] == 4
