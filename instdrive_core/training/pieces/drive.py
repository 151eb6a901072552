"""Training that decides by itself whether a drive is one piece or several, trains them in turn and joins their scenes.

Each piece is an ordinary run in ``pieces/NN`` of the run's folder, so a run that was stopped anywhere goes on there.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.registry import load_clip
from instdrive_core.errors import DataError, OptionError
from instdrive_core.files.atomic import write_bytes
from instdrive_core.files.json_fields import read_json, require_field
from instdrive_core.formats.folder.scenes import read_scene_folder, write_scene_folder
from instdrive_core.scene.scene import Scene
from instdrive_core.tracks.choice import with_tracks
from instdrive_core.training.memory_check import count_affordable_photos, measure_peak_memory
from instdrive_core.training.pieces.cut import choose_present_tracks, cut_clip, list_steps
from instdrive_core.training.pieces.joining import join_pieces
from instdrive_core.training.pieces.plan import (
    DriveSize,
    Piece,
    count_pieces,
    describe_pieces,
    measure_drive,
    plan_pieces,
)
from instdrive_core.training.run import (
    CONFIG,
    FACTS,
    LOG,
    OpenedClip,
    RunRequest,
    check_run_output,
    collect_config,
    run_training,
    write_run_facts,
)
from instdrive_core.training.settings.clip_size import fit_to_clip
from instdrive_core.training.settings.config import PieceChoice
from instdrive_core.training.settings.events import Event

FOLDER, PLAN = "pieces", "pieces.json"
_PLAN_VERSION = 1


@dataclass(frozen=True)
class _Talk:
    """Notes to the user, kept for `run.json`."""

    on_event: Callable[[Event], None]
    on_note: Callable[[str], None]
    told: list[str] = field(default_factory=list)

    def add(self, note: str) -> None:
        self.told.append(note)
        self.on_note(note)


def run_drive(request: RunRequest, on_event: Callable[[Event], None], on_note: Callable[[str], None]) -> Path:
    """Train a drive into `request.out`, in as many pieces as the request says, and return it.

    A drive of one piece is an ordinary run, bit for bit. Raises what `run_training` raises, and OptionError for a
    number of pieces that the drive or the other options rule out.
    """
    if request.pieces == 1:
        return run_training(request, on_event, on_note)
    check_run_output(request)
    talk = _Talk(on_event, on_note)
    talk.add(f"reading {request.clip}")
    clip = load_clip(str(request.clip), request.options)
    if not clip.training_frames:
        raise DataError(request.clip, "no photo of a training time step was found", "Check cameras and frame range.")
    pieces = _plan(request, clip, talk.add)
    if len(pieces) == 1:
        return run_training(request, on_event, on_note, OpenedClip(clip, notes=tuple(talk.told)))
    return _train_pieces(request, clip, pieces, talk)


def find_obstacle(request: RunRequest, clip: Clip) -> str | None:
    """Find why a request cannot be trained in pieces; None where it can."""
    config = request.config
    if request.learner is not None or config.method != "instdrive" or config.instances.learned_by != "votes":
        return f"method '{config.method}' learns codewords that mean nothing beyond one training"
    if request.init is not None:
        return "--init starts from one scene"
    if clip.points is not None and request.pieces == "auto":
        return "without LiDAR the metres are not known"
    return None


def _plan(request: RunRequest, clip: Clip, on_note: Callable[[str], None]) -> tuple[Piece, ...]:
    """The pieces that the folder was begun with, else new ones."""
    kept, steps = request.out / PLAN, list_steps(clip)
    if request.resume and kept.is_file():
        return _read_plan(kept, request.pieces)
    if request.resume:  # an ordinary run
        if request.pieces != "auto":
            raise OptionError(
                f"{request.out}: was begun as one piece, --pieces is {request.pieces}. Choose another --out."
            )
        return plan_pieces(steps, 1)
    size, obstacle = measure_drive(steps), find_obstacle(request, clip)
    count = _count(request, clip, size) if request.pieces == "auto" else request.pieces
    if count == 1:
        return plan_pieces(steps, 1)
    if obstacle is not None:
        if request.pieces != "auto":
            raise OptionError(f"--pieces is {request.pieces}, but {obstacle}. Use --pieces 1.")
        on_note(f"{_describe_size(clip, size)} in one piece: {obstacle}")
        return plan_pieces(steps, 1)
    pieces = plan_pieces(steps, count)
    on_note(describe_pieces(None if clip.points is not None else size.metres, pieces))
    return pieces


def _count(request: RunRequest, clip: Clip, size: DriveSize) -> int:
    config = request.config if request.sizes is None else fit_to_clip(request.config, clip, request.sizes)
    return count_pieces(size, count_affordable_photos(clip, config.densify.max_gaussians))


def _describe_size(clip: Clip, size: DriveSize) -> str:
    way = "" if clip.points is not None else f" along {size.metres:.0f} m"
    return f"{size.photos} training photos{way}"


def _train_pieces(request: RunRequest, clip: Clip, pieces: Sequence[Piece], talk: _Talk) -> Path:
    out, config = request.out, collect_config(request, None)
    if request.resume:
        _check_same_options(out / CONFIG, config)
    out.mkdir(parents=True, exist_ok=True)
    for note in clip.notes:
        talk.add(note)
    drive = with_tracks(clip, request.tracks, out, talk.add)
    write_run_facts(out / PLAN, {"version": _PLAN_VERSION, "pieces": [asdict(piece) for piece in pieces]})
    write_run_facts(out / CONFIG, config)
    for number in range(len(pieces)):
        _train_piece(request, clip, drive, pieces, number, talk)
    talk.add("joining the pieces and writing the scene")

    def open_piece(number: int) -> Scene:
        return read_scene_folder(locate_piece(out, number))

    scene = join_pieces(drive, pieces, open_piece, talk.add)
    write_scene_folder(out, scene)
    _join_logs(out, len(pieces))
    write_run_facts(out / FACTS, _collect_drive_facts(request, pieces, scene, talk.told))
    return out


def _train_piece(
    request: RunRequest, clip: Clip, drive: Clip, pieces: Sequence[Piece], number: int, talk: _Talk
) -> None:
    piece, out = pieces[number], locate_piece(request.out, number)
    title = f"piece {number + 1} of {len(pieces)}"
    if (out / FACTS).is_file():
        talk.add(f"{title} is finished")
        return
    talk.add(f"{title}: steps {piece.first} to {piece.last}, {piece.metres:.0f} m")
    part = OpenedClip(cut_clip(clip, piece), choose_present_tracks(drive.tracks, clip, piece))
    options = replace(request.options, first_frame=piece.first, last_frame=piece.last)
    own = replace(request, out=out, options=options, resume=(out / CONFIG).is_file(), pieces=1)
    run_training(own, talk.on_event, lambda note: talk.add(f"{title}: {note}"), part)


def locate_piece(run: Path, number: int) -> Path:
    """Locate the folder of a run's piece, counted from 0."""
    return run / FOLDER / f"{number:02d}"


def _read_plan(path: Path, asked: PieceChoice) -> tuple[Piece, ...]:
    content = read_json(path)
    if require_field(path, content, "version") != _PLAN_VERSION:
        raise DataError(path, f"has version {content['version']!r}, not {_PLAN_VERSION}", "Train into another --out")
    try:
        pieces = tuple(Piece(**entry) for entry in require_field(path, content, "pieces"))
    except TypeError as error:
        raise DataError(path, f"the field 'pieces' is damaged ({error})", "Train into another --out") from error
    if asked not in ("auto", len(pieces)):
        raise OptionError(f"{path.parent}: was begun in {len(pieces)} pieces, --pieces is {asked}")
    return pieces


def _check_same_options(path: Path, config: dict[str, Any]) -> None:
    if read_json(path) != json.loads(json.dumps(config)):
        raise OptionError(
            f"{path.parent}: was trained with other options than those given. Repeat the run's own ({path}), or choose "
            "another --out."
        )


def _join_logs(out: Path, count: int) -> None:
    """One log of all pieces, its seconds counted on."""
    lines, before = [], 0.0
    for number in range(count):
        steps = [json.loads(line) for line in (locate_piece(out, number) / LOG).read_text().splitlines()]
        lines += [json.dumps(step | {"seconds": step["seconds"] + before}) for step in steps]
        before += max((step["seconds"] for step in steps), default=0.0)
    write_bytes(out / LOG, "".join(line + "\n" for line in lines).encode())


def _collect_drive_facts(
    request: RunRequest, pieces: Sequence[Piece], scene: Scene, notes: list[str]
) -> dict[str, Any]:
    """Facts as of an ordinary run: sums of time and iterations, the largest memory."""
    parts = [read_json(locate_piece(request.out, number) / FACTS) for number in range(len(pieces))]
    first = parts[0]
    return first | {
        **asdict(request.options),
        "iterations": sum(part["iterations"] for part in parts),
        "train_seconds": round(sum(part["train_seconds"] for part in parts), 1),
        "peak_rss_mb": max(round(measure_peak_memory() / 2**20), *(part["peak_rss_mb"] for part in parts)),
        "n_gaussians": len(scene),
        "n_instances": len(scene.table),
        "pieces": [asdict(piece) for piece in pieces],
        "notes": notes,
    }
