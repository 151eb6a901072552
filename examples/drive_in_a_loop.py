"""Close the loop: a toy planner drives by what the server lets it see, and brakes for a parked car put into its lane.

Without a third argument, the address of a running `instdrive serve`, the script starts a server of its own.
"""

from __future__ import annotations

import json
import sys
from contextlib import ExitStack

import numpy as np
from PIL import Image
from scene_and_folder import scene_and_folder

from instdrive_core.project.open import open_document
from instdrive_core.serving.client import SensorClient
from instdrive_core.serving.server import SensorServer
from instdrive_core.serving.service import open_sensor_service

STEP, STEPS = 0.2, 20
SPEED, HARDEST_BRAKE = 10.0, 6.0
"""Metres per second, and per second squared."""
AHEAD, KEPT = 28.0, 6.0
"""Metres to the car in the lane, and those at which the planner wants to stand before it."""


def plan_speed(points: np.ndarray, ground: float, speed: float) -> tuple[float, float]:
    """The speed of the next step, and the metres that are free ahead: of points 0.4 to 2 m above the ground."""
    in_lane = (points[:, 0] > 1.5) & (np.abs(points[:, 1]) < 1.0)
    in_way = in_lane & (points[:, 2] > ground + 0.4) & (points[:, 2] < ground + 2.0)
    free = float(np.quantile(points[in_way, 0], 0.02)) if in_way.sum() >= 5 else np.inf
    allowed = np.sqrt(2 * 0.5 * HARDEST_BRAKE * max(free - KEPT, 0.0))
    return max(min(SPEED, speed + 2.0 * STEP, allowed), speed - HARDEST_BRAKE * STEP, 0.0), free


path, folder = scene_and_folder()
parked = [i for i in open_document(path)[0].scene.table if i.class_name == "Car" and not i.node]
obstacle = str(max(parked, key=lambda instance: instance.count).id)

with ExitStack() as stack:
    if len(sys.argv) > 3:
        address = sys.argv[3]
    else:
        service, _ = open_sensor_service(path, lidar="VLP-16", unnamed="gone")
        address = stack.enter_context(SensorServer(service)).address
    client = stack.enter_context(SensorClient(address))

    camera = client.list_cameras()[0]
    begin = client.fetch_way().world_from_rig[0]
    forward = np.array([*begin[:2, 0] / np.linalg.norm(begin[:2, 0]), 0.0])
    rig = np.eye(4)
    rig[:3, :3] = np.stack([forward, np.cross([0, 0, 1], forward), [0, 0, 1]], axis=1)
    rig[:3, 3] = begin[:3, 3]

    points, _ = client.sweep((0.0, rig), (0.0, rig))
    ground = float(np.median(points[(points[:, 0] > 4) & (points[:, 0] < 15) & (np.abs(points[:, 1]) < 2), 2]))
    stands = rig.copy()
    stands[:3, 3] += AHEAD * forward + [0, 0, ground + 0.75]
    placed = {obstacle: stands}

    speed, driven, told = SPEED, 0.0, []
    for step in range(STEPS):
        time, before = step * STEP, rig.copy()
        rig[:3, 3] += speed * STEP * forward
        driven += speed * STEP
        points, _ = client.sweep((time, before), (time + STEP, rig), placed)
        speed, free = plan_speed(points, ground, speed)
        told.append({"time": time, "driven": driven, "speed": speed, "free": free if np.isfinite(free) else None})
        if step in (0, STEPS - 1):
            picture = client.draw(camera.mount(rig), time + STEP, placed)
            Image.fromarray(picture).save(folder / ("first.png" if step == 0 else "last.png"))

(folder / "loop.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
gap = AHEAD - driven
print(f"drove {driven:.1f} m and stands {gap:.1f} m before the centre of {obstacle}: loop.json, first.png, last.png")
