"""``python -m benchmarks.serving --run RUN``: how quickly `instdrive serve` answers. One JSON line.

`serve_ms` is the median over pictures of 480 pixels' width, each of another camera and moment of the drive, with one
thing placed by the request: from the message sent to the picture unpacked, over the network of this machine.
`serve_worst_ms` is the slowest of them, `serve_sweep_s` the median of sweeps of PANDAR128.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro

from instdrive_core.errors import InstDriveError
from instdrive_core.serving.client import SensorClient
from instdrive_core.serving.server import SensorServer
from instdrive_core.serving.service import open_sensor_service
from instdrive_core.serving.stage import find_object_pose

WIDTH = 480


@dataclass(frozen=True)
class Options:
    """What is served."""

    run: Path
    """Run, scene folder or project."""
    pictures: int = 40
    sweeps: int = 5


def measure_serving(run: Path, pictures: int = 40, sweeps: int = 5) -> dict[str, Any]:
    """Serve a run, and measure the answers."""
    service, _ = open_sensor_service(run)
    service.warm_up()
    stage = service.stage
    name, staged = next((name, staged) for name, staged in stage.things.items() if not staged.node)
    views = [stage.scene.views[k] for k in np.linspace(0, len(stage.scene.views) - 1, pictures).round().astype(int)]
    drawn, cast = [], []
    with SensorServer(service) as server, SensorClient(server.address) as client:
        for view in views:
            pose = find_object_pose(stage.scene, staged.thing, view.time)
            pose[0, 3] += 1.0
            started = time.perf_counter()
            client.draw(view.camera.scale(WIDTH / view.camera.width), view.time, {name: pose})
            drawn.append(time.perf_counter() - started)
        rig = service.rig
        for step in range(sweeps):
            start, end = ((float(rig.times[k]), rig.world_from_rig[k]) for k in (step, step + 1))
            started = time.perf_counter()
            client.sweep(start, end)
            cast.append(time.perf_counter() - started)
    height = round(WIDTH * views[0].camera.height / views[0].camera.width)
    return {
        "serve_ms": round(1000 * float(np.median(drawn)), 1),
        "serve_worst_ms": round(1000 * max(drawn), 1),
        "serve_sweep_s": round(float(np.median(cast)), 2),
        "serve_splats": len(stage.scene),
        "serve_size": f"{WIDTH}x{height}",
    }


if __name__ == "__main__":
    try:
        options = tyro.cli(Options)
        print(json.dumps(measure_serving(options.run, options.pictures, options.sweeps)))
    except InstDriveError as error:
        sys.exit(str(error))
