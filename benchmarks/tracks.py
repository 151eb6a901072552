"""Moving objects found without labels, against a clip's annotated movers.

`python -m benchmarks.tracks CLIP` prints one JSON line. Movers are annotated objects that travel more than 1 m, count
within 80 m, twins once; `found` and `movers` count those with at least 100 points in a sweep, `found_30` and
`movers_30` those with at least 30. `followed` is the share of all points on movers that tracks carry. Errors are those
of centres along the ground, in metres.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import tyro
from tyro.conf import Positional

from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import InstDriveError
from instdrive_core.evaluation.metrics.track_scores import find_annotated_movers, score_tracks
from instdrive_core.tracks.finder import find_tracks


@dataclass(frozen=True)
class Options:
    """Compare tracks found in LiDAR sweeps with annotated ones."""

    clip: Positional[Path]
    held_out: bool = False
    """Use the sweeps of held-out time steps, too."""
    options: ClipOptions = field(default_factory=ClipOptions)


def main(options: Options) -> dict[str, object]:
    """Everything the JSON line says."""
    clip = load_clip(str(options.clip), options.options)
    start = time.perf_counter()
    found = find_tracks(clip, options.held_out)
    seconds = time.perf_counter() - start
    scores = score_tracks(found.tracks, find_annotated_movers(clip), clip.true_tracks)
    errors = scores.errors
    return {
        "clip": clip.name,
        "found": scores.found,
        "movers": scores.movers,
        "found_30": scores.found_30,
        "movers_30": scores.movers_30,
        "median_error_m": round(float(np.median(errors)), 4) if len(errors) else None,
        "p90_error_m": round(float(np.percentile(errors, 90)), 4) if len(errors) else None,
        "followed": round(scores.followed, 4),
        "switches": scores.switches,
        "false": scores.false,
        "tracks": len(found.tracks),
        "missed": [one[:8] for one in scores.missed],
        "false_ids": list(scores.false_ids),
        "seconds": round(seconds, 1),
    }


if __name__ == "__main__":
    try:
        print(json.dumps(main(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
