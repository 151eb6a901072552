"""The real clip's annotated movers are found, where it lies beside the project."""

from pathlib import Path

import numpy as np
import pytest

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.evaluation.metrics.track_scores import find_annotated_movers, score_tracks
from instdrive_core.tracks.finder import find_tracks

CLIP = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "pandaset" / "002"


@pytest.mark.slow
@pytest.mark.skipif(not (CLIP / "lidar").is_dir(), reason="the shared clip is not here")
def test_movers_of_the_shared_clip_are_found():
    clip = load_clip(str(CLIP), ClipOptions(first_frame=30, last_frame=41, cameras="1"))
    scores = score_tracks(find_tracks(clip).tracks, find_annotated_movers(clip), clip.tracks)
    assert scores.found >= 0.75 * scores.movers
    assert np.median(scores.errors) < 0.2
    assert scores.switches == 0
    assert scores.false <= 2
