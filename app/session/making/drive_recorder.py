"""Records the edited drive as sensor data, in a process of its own that goes on where an earlier one was stopped."""

from __future__ import annotations

import json
import os.path
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from instdrive_app.files.file_names import find_folder_beside
from instdrive_app.jobs import Job
from instdrive_app.session.context import SessionContext
from instdrive_app.session.driving.ego_way import EgoWay
from instdrive_app.session.files.document_files import DocumentFiles
from instdrive_app.session.making.child import CommandFailedError, clean_complaint, start_command
from instdrive_core.progress import report
from instdrive_core.project.save import SUFFIX, ProjectState, capture_project_state, write_project
from instdrive_core.recording.folder import LOCK, PLAN
from instdrive_core.scene.ways.drawn_way import DrawnWay, describe_drawn_way
from instdrive_core.sweeps.sensor import NONE
from instdrive_core.wording import phrase

LAYOUTS = {
    "pandaset": "PandaSet",
    "nuscenes": "nuScenes",
    "t4": "T4",
    "kitti-tracking": "KITTI tracking",
    "kitti-raw": "KITTI raw",
    "kitti-360": "KITTI-360",
    "argoverse": "Argoverse 2",
    "waymo": "Waymo",
    "drivestudio": "drivestudio",
    "coco": "COCO",
    "mcap": "MCAP",
}
"""Layouts of data sets that `instdrive simulate` writes, too, and their titles."""
Way = Literal["own", "shift", "lane", "speed", "stop", "drawn", "file"]
PROGRESS = "progress "
"""Beginning of the lines that say how far the command is."""
_LOOK_SECONDS = 0.2
_END_SECONDS = 10.0


@dataclass(frozen=True)
class RecordChoice:
    """Everything the user chose besides the folder."""

    width: int | None = None
    """Pixels; None = as in training."""
    way: Way = "own"
    amount: float = 2.0
    """Metres to the left, factor of the speed, second of the drive, or m/s (0: as recorded), as the way needs it."""
    way_file: str = ""
    """File of the way `file`: keys as JSON, or OpenSCENARIO, with #ENTITY or without."""
    flow: bool = False
    confidence: bool = False
    layouts: tuple[str, ...] = ()
    shutter: float = 0.0
    """Seconds from a picture's first to its last line; 0 = all at once."""
    rig: str = ""
    """JSON file of the cameras that record; empty = the drive's own."""
    video: str = ""
    """mp4 or webm; empty = no videos."""
    exr: bool = False
    """Whether depth in metres is written as OpenEXR instead of NumPy's files."""
    lidar: str = ""
    """`none` or a sensor's name; empty = the clip's own, where its sweeps are at hand."""
    ray_drop: bool = False
    """Whether surfaces lose rays of the LiDAR as often as in the clip's sweeps."""

    def list_arguments(self) -> list[str]:
        """List the arguments of `instdrive simulate`, but for a drawn way, which has a file of its own."""
        arguments = [] if self.width is None else ["--width", str(self.width)]
        ways = {"shift": f"shift={self.amount:g}", "lane": f"lane={self.amount:g}@0.5"}
        ways |= {"speed": f"speed={self.amount:g}", "stop": f"stop={self.amount:g}"}
        ways |= {"file": f"path={os.path.expanduser(self.way_file.strip())}"}
        arguments += ["--ego", ways[self.way]] if self.way in ways else []
        arguments += ["--flow"] * (self.flow and not self.shutter) + ["--confidence"] * self.confidence
        arguments += ["--shutter", f"{self.shutter:g}"] if self.shutter else []
        arguments += ["--rig", os.path.expanduser(self.rig.strip())] if self.rig.strip() else []
        arguments += ["--video", self.video] if self.video else []
        arguments += ["--depth-format", "exr"] * self.exr
        arguments += ["--lidar", self.lidar] if self.lidar else []
        arguments += ["--ray-drop"] * (self.ray_drop and self.lidar != NONE)
        return [*arguments, "--layout", *self.layouts] if self.layouts else arguments


class DriveRecorder:
    """Holds the choice of the dialog, and records."""

    def __init__(self, context: SessionContext, files: DocumentFiles, ego_way: EgoWay) -> None:
        self._context, self._files, self._ego_way = context, files, ego_way
        self.choice = RecordChoice()
        self._job: Job | None = None

    @property
    def is_running(self) -> bool:
        """Whether a recording waits or runs."""
        return self._job is not None and not self._job.over

    def propose_folder(self) -> Path:
        """Propose a folder beside the scene."""
        source = self._files.path
        stem = source.name.split(".")[0].removesuffix("_edited") if source else "scene"
        return find_folder_beside(self._files.last_export or source) / f"{stem}_recording"

    def begin(self, folder: Path, choice: RecordChoice) -> None:
        """Record the document as it is now; edits wait until it is done or cancelled."""
        document = self._context.document
        if document is None or self.is_running:
            return
        self.choice = choice
        state = capture_project_state(document)
        drawn = self._ego_way.build(choice.amount or None) if choice.way == "drawn" else None

        def finish(said: str) -> None:
            self._files.last_export = folder
            self._context.messages.info(phrase("Recorded {said}", said=said))

        self._job = self._context.jobs.submit(
            phrase("Recording {name}", name=folder.name),
            lambda: record_in_process(state, folder, choice.list_arguments(), drawn),
            finish,
        )

    def close(self) -> None:
        """Stop a recording; the next one into the same folder goes on."""
        if self._job is not None:
            self._job.stop.set()


def find_folder_problem(folder: str) -> str:
    """Say why a recording cannot go into a folder, for the user; empty where it can."""
    path = os.path.expanduser(folder)
    if not folder.strip():
        return "Name a folder"
    if os.path.lexists(path) and not os.path.isdir(path):
        return "This is a file; name a folder"
    if os.path.isdir(path) and not is_begun(folder) and any(name != LOCK for name in _list_names(path)):
        return "This folder holds something else; name a new one"
    return ""


def is_begun(folder: str) -> bool:
    """Whether a recording was begun in a folder."""
    return os.path.isfile(os.path.join(os.path.expanduser(folder), PLAN))


def _list_names(path: str) -> list[str]:
    try:
        return os.listdir(path)
    except OSError:  # what cannot be listed cannot be recorded into: the command says why
        return []


def record_in_process(state: ProjectState, folder: Path, arguments: list[str], drawn: DrawnWay | None = None) -> str:
    """Record a project's state by `instdrive simulate`, on the `drawn` way if there is one; returns what it said.

    A cancelled recording leaves whole files, so that the next one goes on. Raises CommandFailedError with what the
    command complained of.
    """
    with TemporaryDirectory(prefix="instdrive-record-") as temporary:
        project, output = Path(temporary, f"drive{SUFFIX}"), Path(temporary, "output.txt")
        write_project(project, state)
        command = ["simulate", str(project), "-o", str(folder), "--progress", "lines", *arguments]
        if drawn is not None:
            way = Path(temporary, "way.json")
            way.write_text(json.dumps(describe_drawn_way(drawn)), encoding="utf-8")
            command += ["--ego", f"path={way}"]
        process = start_command(output, *command)
        try:
            while process.poll() is None:
                report(_read_share(output))
                time.sleep(_LOOK_SECONDS)
        finally:
            _end(process)
        text = output.read_text(encoding="utf-8", errors="replace")
        if process.returncode:
            raise CommandFailedError(clean_complaint(text))
        said = [line for line in text.splitlines() if line.startswith(str(folder))]
        return said[0].replace(": ", ", ", 1) if said else str(folder)


def _read_share(output: Path) -> float:
    """The last share that the command printed."""
    lines = output.read_text(encoding="utf-8", errors="replace").splitlines()
    shares = [line.removeprefix(PROGRESS) for line in lines if line.startswith(PROGRESS)]
    try:
        return float(shares[-1]) if shares else 0.0
    except ValueError:  # half a line
        return 0.0


def _end(process: subprocess.Popen[bytes]) -> None:
    if process.poll() is None:
        process.terminate()
        try:
            process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
