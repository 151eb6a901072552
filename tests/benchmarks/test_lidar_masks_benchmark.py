"""The figures and the picture that compare LiDAR masks with ground truth."""

import numpy as np
from painted_street import CAR, ROAD, SKY, WALL, painted_clip, truth

from benchmarks.lidar_masks import compute_figures, draw_picture, score_photo
from instdrive_core.masks.ground_truth_instance import GroundTruthInstance


class KnownStreet:
    """The painted street's truth, with or without a mistake, as both ground truth and masks."""

    source = "exact"
    instances = {  # noqa: RUF012
        ROAD: GroundTruthInstance(ROAD, "Road", "Road", "stuff"),
        WALL: GroundTruthInstance(WALL, "Building", "Building", "stuff"),
        CAR: GroundTruthInstance(CAR, "Car", "Car", "thing"),
    }

    def __init__(self, split=False):
        self.split = split

    def load(self, frame):
        labels = truth(frame.view.time).astype(np.uint32)
        if self.split:
            rows, columns = np.nonzero(labels == CAR)
            left = columns < np.median(columns)
            labels[rows[left], columns[left]] = 99
        return labels

    def load_sky(self, frame):
        return truth(frame.view.time) == SKY


def test_figures_know_whole_from_split():
    frames = painted_clip("", range(2, 16)).training_frames[:2]
    perfect = compute_figures([score_photo(KnownStreet(), KnownStreet(), frame) for frame in frames])
    assert {perfect[key] for key in ("things_best_iou", "things_iou50", "per_view_miou", "pq", "sky_iou")} == {1.0}
    split = compute_figures([score_photo(KnownStreet(), KnownStreet(split=True), frame) for frame in frames])
    assert 0.45 < split["things_best_iou"] < 0.6
    assert split["stuff_best_iou"] == 1.0
    assert split["masks_per_photo"] == 4
    assert split["pq"] < 0.9
    drawn = draw_picture(KnownStreet(), KnownStreet(split=True), frames)
    assert drawn.shape == (2 * 90, 3 * 160, 3)
    assert (drawn[:, :160] == np.vstack([frame.load_image() for frame in frames])).all()
