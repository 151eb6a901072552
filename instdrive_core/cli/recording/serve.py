"""``instdrive serve``: the edited drive's sensors for a simulator."""

from __future__ import annotations

import importlib
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import tyro

from instdrive_core.errors import OptionError
from instdrive_core.serving.requests import Limits

PORT = 50051
"""The usual one of gRPC servers."""
_LOOK_SECONDS = 0.5
"""On some systems a wait without an end is not woken by signals."""
LOCAL = ("127.0.0.1", "::1", "localhost")


def serve_drive(
    scene: tyro.conf.Positional[Path],
    *,
    port: int = PORT,
    host: str = LOCAL[0],
    lidar: str | None = None,
    rig: Path | None = None,
    unnamed: Literal["drive", "gone"] = "drive",
    max_pixels: int = Limits.pixels,
    max_requests: int = Limits.requests,
    max_rate: int = Limits.rate,
    ray_drop: bool = False,
) -> None:
    """Answer a simulator's requests for cameras and LiDAR of the edited drive, over gRPC, until Ctrl+C.

    Args:
        scene: Run or scene folder, or a project on one: what its edits made of the drive.
        port: Port to listen at; 0 takes a free one and prints it.
        host: Address to listen at. Others than 127.0.0.1 let other machines in: nothing is encrypted, and nobody is
            asked for a password.
        lidar: The sensor whose sweeps are cast: own (as the clip's sweeps show it), PANDAR128, VLP-16, HDL-64E, OS1-128
            or a JSON file that describes one. Default: PANDAR128, the one that AlpaSim's requests name.
        rig: JSON file of the cameras that are listed instead of the drive's own, as `instdrive simulate` takes it. A
            request may describe any other camera.
        unnamed: What moving things do that a request does not name: drive on as recorded, or be gone.
        max_pixels: Pixels of all pictures that one request may ask for.
        max_requests: Requests in flight; more are refused at once.
        max_rate: Pixels and rays a second that all requests together may ask for; more are refused at once.
        ray_drop: Let surfaces lose rays of the LiDAR as often as in the clip's own sweeps; equal frames lose the same.
    """
    from instdrive_core.serving.server import SensorServer
    from instdrive_core.serving.service import open_sensor_service

    if not 0 <= port <= 65535:
        raise OptionError(f"--port is {port}; it must be from 0 (a free one) to 65535")
    for option, value in (("--max-pixels", max_pixels), ("--max-requests", max_requests), ("--max-rate", max_rate)):
        if value < 1:
            raise OptionError(f"{option} is {value}; it must be at least 1")
    importlib.import_module("grpc")  # that it is missing is said before a large scene is opened
    limits = Limits(pixels=max_pixels, requests=max_requests, rate=max_rate)
    service, notes = open_sensor_service(scene, lidar, unnamed, limits, rig, ray_drop)
    service.warm_up()
    for note in notes:
        print(note)
    stopped = threading.Event()
    with _on_signals(stopped), SensorServer(service, host, port) as server:
        if host not in LOCAL:
            print(f"other machines can connect to {host}: nothing is encrypted, and nobody is asked for a password")
        print(f"serving {service.name} at {server.address}; Ctrl+C stops", flush=True)
        while not stopped.wait(_LOOK_SECONDS):
            pass
        print("stopping", flush=True)


@contextmanager
def _on_signals(stopped: threading.Event) -> Iterator[None]:
    """Set `stopped` on Ctrl+C and when the process is asked to end, instead of breaking off whatever it is doing.

    Once that happened the process is about to end, and does not want to hear it again.
    """
    numbers = (signal.SIGINT, signal.SIGTERM)
    before = [signal.signal(number, lambda *_: stopped.set()) for number in numbers]
    try:
        yield
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, signal.SIG_IGN if stopped.is_set() else handler)
