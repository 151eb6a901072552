"""``python -m benchmarks.recording``: a trained synthetic street recorded again, as it is and edited. One JSON line.

Round trip: `psnr_gap` is what `eval` measures on held-out photos less what the recorded pictures reach (dB), `box_iou`
the mean overlap of recorded 3D boxes with the true ones (`box_iou_fitted`: without the clip's annotations),
`mask_miou` that of recorded instance masks, beside `eval_miou`. `seconds_120_views` is what recording took, counted
for 120 views.

Counterfactual: a parked car is deleted, another one and a driving one are moved by 3 m, in the editor's scene and in
the street itself, which is ray-traced again. `edit_psnr` is over the pixels that the edits change
(`edit_psnr_before`: over the same pixels without edits, what the scene reaches at all; `edit_psnr_seen`: over those,
`edit_seen_share` of them, whose point of the street some training photo shows, wherever it was then;
`edit_psnr_trusted`: over those with a confidence of at least a half, `edit_trusted_share` of them;
`edit_psnr_median_view`: of the median photo), `edit_mask_iou` the overlap of the moved cars' masks.

`edit_box_iou` is the mean overlap of the moved cars' boxes with the true ones; a box of the deleted car counts as 0.

`lidar_median_m`, `seconds_sweep` and their kin are what `benchmarks.sweeps` measures of the same run, `real_…` of a
second one, `serve_ms` and its kin what `benchmarks.serving` does.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from jaxtyping import Bool, UInt32
from numpy import ndarray

from benchmarks.box_overlap import compute_box_iou
from benchmarks.hole_streets import train_street
from benchmarks.seen_truth import find_seen_pixels, place_camera
from benchmarks.serving import measure_serving
from benchmarks.sweeps import measure_sweeps
from instdrive_core.datasets.clip import Clip
from instdrive_core.datasets.registry import load_clip
from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.sensors.render import RenderedPhoto, StepRenderer
from instdrive_core.datasets.synthetic.units import StreetUnits
from instdrive_core.datasets.synthetic.world.street import Street
from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.document.frozen_copy import freeze_document
from instdrive_core.edits.holes.scene_light import estimate_light
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.light.cast_shadows import find_put, plan_shadows
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.kinds.shape.complete import make_completion
from instdrive_core.errors import EditError, InstDriveError
from instdrive_core.evaluation.metrics.held_out import HeldOutView, measure_held_out_view
from instdrive_core.evaluation.metrics.image_metrics import psnr
from instdrive_core.evaluation.metrics.map_scores import score_views
from instdrive_core.evaluation.run_facts import build_clip_options, read_run_facts
from instdrive_core.masks.ground_truth import find_ground_truth
from instdrive_core.project.open import open_document
from instdrive_core.recording.boxes import place_boxes
from instdrive_core.recording.drive import Drive, take_drive
from instdrive_core.recording.folder import name_file, read_color, read_id_map, read_share
from instdrive_core.recording.plan import RecordOptions
from instdrive_core.recording.record import record_drive
from instdrive_core.recording.things import find_boxed_things
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.training.settings.config import Preset

SHIFT = 3.0
"""Metres by which cars are moved."""
TRUSTED = 0.5
"""Confidence from which a recorded pixel is trusted."""
CHANGED = 10
"""Steps of 255: a pixel whose colour differs by more was changed by the edits."""
LEAST_SEEN = 100
"""Pixels from which an instance of a photo counts, as in `eval`."""


@dataclass(frozen=True)
class Options:
    """What is recorded."""

    run: Path | None = None
    """A run trained on a synthetic clip; default: a street is recorded and trained."""
    folder: Path | None = None
    """Where street, run and recordings are kept; default: a temporary folder."""
    preset: Preset = "quick"
    views: int = 18
    """Photos of the edited street that are compared."""
    real: Path | None = None
    """A run on a real drive, whose held-out sweeps are cast, too."""


def measure_recording(options: Options) -> dict[str, Any]:
    """Everything the JSON line says."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.folder or Path(temporary)
        run = options.run or train_street(StreetConfig(), folder, options.preset)
        facts = read_run_facts(run)
        clip = load_clip(facts["clip"], build_clip_options(facts))
        document, _ = open_document(run)
        drive = take_drive(document, RecordOptions(exposed=True))
        started = time.perf_counter()
        record_drive(folder / "recorded", drive)
        seconds = time.perf_counter() - started
        found = _measure_round_trip(folder / "recorded", drive, clip)
        found |= {"views": len(drive.views), "seconds_120_views": round(seconds * 120 / len(drive.views), 1)}
        found |= _measure_edits(folder, document, clip, options.views) | measure_sweeps(run) | measure_serving(run)
        real = measure_sweeps(options.real) if options.real is not None else {}
        return found | {f"real_{key}": value for key, value in real.items()}


def _measure_round_trip(folder: Path, drive: Drive, clip: Clip) -> dict[str, Any]:
    truth, posed = find_ground_truth(clip), clip.with_cameras(drive.scene.views)
    held_out = [measure_held_out_view(drive.scene, posed, frame, truth) for frame in posed.held_out_frames]
    photos = [_compare_photo(folder, view) for view in held_out]
    recorded = [view.with_map(_read_ids(folder, view.frame.view)) for view in held_out]
    evaluated = [view.with_ids(drive.scene.instance_ids) for view in held_out]
    owners = _match_instances(folder, clip, drive.scene)
    drawn = float(np.mean([view.psnr for view in held_out if view.psnr is not None]))
    return {
        "psnr": round(float(np.mean(photos)), 2),
        "psnr_gap": round(drawn - float(np.mean(photos)), 3),
        **_measure_boxes(drive, clip, owners, "box_iou"),
        **_measure_boxes(replace(drive, annotated=()), clip, owners, "box_iou_fitted"),
        "mask_miou": _round(score_views(recorded)["miou"]),
        "eval_miou": _round(score_views(evaluated)["miou"]),
    }


def _compare_photo(folder: Path, view: HeldOutView) -> float:
    frame = view.frame
    picture = read_color(folder / name_file("color", frame.view, ".png")).astype(np.float32) / 255
    valid = np.ones(picture.shape[:2], bool) if frame.valid is None else frame.valid
    found = psnr(picture, frame.load_image().astype(np.float32) / 255, valid)
    assert found is not None
    return found


def _read_ids(folder: Path, view: CameraView) -> UInt32[ndarray, "h w"]:
    return read_id_map(folder / name_file("instances", view, ".png"))


def _match_instances(folder: Path, clip: Clip, scene: Scene) -> dict[str, int]:
    """The recorded instance that shows most of each track's true pixels, by the track's ID; what no photo shows
    in a hundred pixels is left out."""
    truth = find_ground_truth(clip)
    facts = json.loads((Path(clip.path) / "labels" / "instances.json").read_text())
    names = {int(number): fact["uuid"] for number, fact in facts.items() if fact["uuid"]}
    width = max(scene.table.instances, default=0) + 1
    shared = np.zeros((max(names, default=0) + 1, width), np.int64)
    largest = np.zeros(len(shared), np.int64)
    for frame in clip.frames:
        labels, ids = truth.load(frame).astype(np.int64), _read_ids(folder, frame.view).astype(np.int64)
        inside = labels < len(shared)
        counted = np.bincount((labels * width + ids)[inside], minlength=shared.size)
        shared += counted.reshape(shared.shape)
        largest = np.maximum(largest, np.bincount(labels[inside], minlength=len(shared)))
    return {
        uuid: int(shared[number, 1:].argmax()) + 1
        for number, uuid in names.items()
        if largest[number] >= LEAST_SEEN and shared[number, 1:].any()
    }


def _measure_boxes(drive: Drive, clip: Clip, owners: dict[str, int], key: str) -> dict[str, Any]:
    """Overlaps of the boxes of all seen things with the true boxes, at all moments; what has no box counts as 0."""
    things, overlaps = find_boxed_things(drive.scene, drive.moves, drive.annotated), []
    for moment in sorted({view.time for view in drive.views}):
        placed = {box.thing.instance.id: box for box in place_boxes(drive.scene, things, moment)}
        for track in clip.true_tracks:
            if track.id not in owners or not track.covers(moment, 0.01):
                continue
            box, true = placed.get(owners[track.id]), track.interpolate_pose(moment)
            overlaps.append(
                0.0
                if box is None
                else compute_box_iou(box.world_from_box, box.thing.dimensions, true, track.dimensions)
            )
    return {key: round(float(np.mean(overlaps)), 4), f"{key}_median": round(float(np.median(overlaps)), 4)}


@dataclass(frozen=True)
class _Edited:
    """The street and the scene, both edited."""

    street: Street
    document: Document
    moved: dict[int, int]
    """Instance of each moved car, by its number among the street's actors."""
    touched: tuple[int, ...]
    """Actors that an edit concerns."""


def _measure_edited_boxes(
    street: Street, edited: _Edited, drive: Drive, clip: Clip, owners: dict[str, int]
) -> dict[str, Any]:
    """Overlaps of the moved cars' boxes with the true ones; a box of the deleted one counts as 0."""
    things, overlaps = find_boxed_things(drive.scene, drive.moves, drive.annotated), []
    tracks, world = {track.id: track for track in clip.true_tracks}, street.world_from_street()
    for moment in sorted({view.time for view in drive.views}):
        placed = {box.thing.instance.id: box for box in place_boxes(drive.scene, things, moment)}
        for actor in edited.touched:
            uuid = str(street.actors[actor].uuid)
            box, track = placed.get(owners[uuid]), tracks[uuid]
            if actor not in edited.moved:
                overlaps += [0.0] if box is not None else []
            elif track.covers(moment, 0.01):
                before, after = (
                    world @ known.box_pose(known.actors[actor], moment) for known in (street, edited.street)
                )
                true = track.interpolate_pose(moment)
                true[:3, 3] += (after - before)[:3, 3]
                here = None if box is None else (box.world_from_box, box.thing.dimensions)
                overlaps.append(0.0 if here is None else compute_box_iou(*here, true, track.dimensions))
    return {"edit_box_iou": round(float(np.mean(overlaps)), 4), "edit_boxes": len(overlaps)}


def _measure_edits(folder: Path, document: Document, clip: Clip, count: int) -> dict[str, Any]:
    street = StreetUnits(clip.path).street
    owners = _match_instances(folder / "recorded", clip, document.scene)
    edited = _edit_both(street, document, owners, max(frame.view.time for frame in clip.frames))
    views = _choose_views(clip, street, edited.touched, count)
    asked = {(view.name, view.index) for view in views}
    drive = take_drive(edited.document, RecordOptions(exposed=True, confidence=True))
    drive = replace(drive, views=tuple(view for view in drive.views if (view.name, view.index) in asked))
    record_drive(folder / "edited", drive)
    boxes = _measure_edited_boxes(street, edited, drive, clip, owners)
    squares: dict[str, list[ndarray]] = {"after": [], "before": []}
    trusted: list[ndarray] = []
    maps: list[ndarray] = []
    shared, joined = 0, 0
    for view in views:
        before, after = _photograph(street, clip, view), _photograph(edited.street, clip, view)
        changed = _find_changes(before, after)
        maps.append(changed)
        squares["after"].append(
            _square(read_color(folder / "edited" / name_file("color", view, ".png")), after)[changed]
        )
        squares["before"].append(
            _square(read_color(folder / "recorded" / name_file("color", view, ".png")), before)[changed]
        )
        confidence = read_share(folder / "edited" / name_file("confidence", view, ".png"))
        trusted.append(confidence[changed] >= TRUSTED)
        ids = _read_ids(folder / "edited", view)
        for actor, instance in edited.moved.items():
            true, shown = after.labels == edited.street.actor_id(actor), ids == instance
            if true.sum() >= LEAST_SEEN:
                shared, joined = shared + int((true & shown).sum()), joined + int((true | shown).sum())
    seen = find_seen_pixels(street, edited.street, clip, views, maps)
    known = [each[changed] for each, changed in zip(seen, maps, strict=True)]
    return boxes | {
        "edit_psnr": _to_decibels(squares["after"]),
        "edit_psnr_seen": _to_decibels([each[sure] for each, sure in zip(squares["after"], known, strict=True)]),
        "edit_seen_share": round(float(np.concatenate(known).mean()), 4),
        "edit_psnr_trusted": _to_decibels([each[sure] for each, sure in zip(squares["after"], trusted, strict=True)]),
        "edit_trusted_share": round(float(np.concatenate(trusted).mean()), 4),
        "edit_psnr_median_view": float(np.median([_to_decibels([each]) for each in squares["after"] if len(each)])),
        "edit_psnr_before": _to_decibels(squares["before"]),
        "edit_mask_iou": round(shared / max(joined, 1), 4),
        "edit_pixels": int(sum(len(square) for square in squares["after"])),
        "edit_views": len(views),
    }


def _edit_both(street: Street, document: Document, owners: dict[str, int], duration: float) -> _Edited:
    """Delete the parked car of most splats, and move the next one that has room, and a driving one."""
    count = {instance.id: instance.count for instance in document.scene.table}
    cars = [
        number
        for number, actor in enumerate(street.actors)
        if actor.label == "Car" and str(actor.uuid) in owners and owners[str(actor.uuid)] in count
    ]
    owner = {number: owners[str(street.actors[number].uuid)] for number in cars}
    cars.sort(key=lambda number: -count[owner[number]])
    parked = [number for number in cars if not street.actors[number].route.moves]
    gone = parked[0]
    roomy = (
        (number, shift)
        for number in [*parked[1:], *(number for number in cars if street.actors[number].route.moves)]
        for shift in (SHIFT, -SHIFT)
        if _has_room(street, number, shift, gone, duration)
    )
    moves: dict[int, float] = {}
    for number, shift in roomy:
        kinds = {not street.actors[known].route.moves for known in moves}
        if (not street.actors[number].route.moves) not in kinds:
            moves[number] = shift
    actors = list(street.actors)
    for number, shift in moves.items():
        actors[number] = replace(actors[number], route=_shift_route(street, number, shift))
    edited = replace(street, actors=tuple(actors))
    light = estimate_light(document, 0.0)
    for number in moves:
        poses = [known.world_from_street() @ known.box_pose(known.actors[number], 0.0) for known in (street, edited)]
        x, y, z = (poses[1] - poses[0])[:3, 3].tolist()
        stands = not street.actors[number].route.moves
        with suppress(EditError):  # both sides were seen
            document.apply(make_completion(document, owner[number]))
        move = MoveInstances((owner[number],), (x, y, z))
        _clean_up(document, owner[number], move, stands)
        for shadow in plan_shadows(freeze_document(document), find_put(move), light, 0.0):
            document.apply(shadow)
    _clean_up(document, owner[gone], DeleteInstances((owner[gone],)), True)
    # Its number stays taken, so that the others keep theirs: what was deleted is put far below the street.
    whole = street.actors[gone].model
    actors[gone] = replace(street.actors[gone], model=lambda metres: whole(metres).transform(_below()))
    return _Edited(
        replace(street, actors=tuple(actors)), document, {number: owner[number] for number in moves}, (gone, *moves)
    )


def _clean_up(document: Document, instance: int, edit: Edit, fills: bool) -> None:
    """Take a thing away by an edit, and do what the editor offers about what that leaves."""
    left = report_deletion(document, (instance,), 0.0) if fills else None
    document.apply(edit)
    for cleaning in () if left is None else (left.make_absorb_edit(), *left.make_fill_edits()):
        if cleaning is not None:
            document.apply(cleaning)


def _below() -> ndarray:
    pose = np.eye(4)
    pose[2, 3] = -1000.0
    return pose


def _shift_route(street: Street, number: int, shift: float) -> Any:
    """An actor's way, shifted along its direction."""
    route = street.actors[number].route
    return replace(route, x=route.x - shift * np.sin(route.yaw), y=route.y + shift * np.cos(route.yaw))


def _has_room(street: Street, number: int, shift: float, gone: int, duration: float) -> bool:
    """Whether a shifted actor stands in no other one, the deleted one left out."""
    moved = replace(street.actors[number], route=_shift_route(street, number, shift))
    for moment in np.linspace(0, duration, 5).tolist():
        pose = street.box_pose(moved, moment)
        for other, actor in enumerate(street.actors):
            if other in (number, gone):
                continue
            if compute_box_iou(pose, moved.dimensions, street.box_pose(actor, moment), actor.dimensions) > 0:
                return False
    return True


def _choose_views(clip: Clip, street: Street, touched: tuple[int, ...], count: int) -> list[CameraView]:
    """Photos of what is edited, the same number for each thing, from those that show most of it to those that show
    least."""
    truth, chosen = find_ground_truth(clip), dict[tuple[str, int], CameraView]()
    ids = [street.actor_id(number) for number in touched]
    areas = np.array([[int((labels == one).sum()) for one in ids] for labels in map(truth.load, clip.frames)])
    for column in range(len(ids)):
        order = np.argsort(-areas[:, column], kind="stable")
        order = order[areas[order, column] >= LEAST_SEEN]
        spread = np.linspace(0, max(len(order) - 1, 0), min(count // len(ids), len(order))).round().astype(int)
        for place in order[spread].tolist():
            view = clip.frames[place].view
            chosen[view.name, view.index] = view
    return list(chosen.values())


def _photograph(street: Street, clip: Clip, view: CameraView) -> RenderedPhoto:
    camera = place_camera(street, clip, view.camera)
    return StepRenderer(street.geometry(view.time), street.materials, street.light).photograph(camera)


def _find_changes(before: RenderedPhoto, after: RenderedPhoto) -> Bool[ndarray, "h w"]:
    apart = np.abs(before.image.astype(int) - after.image).max(axis=2) > CHANGED
    return apart | (before.labels != after.labels)


def _square(picture: ndarray, truth: RenderedPhoto) -> ndarray:
    return ((picture.astype(np.float64) - truth.image) / 255) ** 2


def _to_decibels(squares: list[ndarray]) -> float:
    return round(float(-10 * np.log10(np.concatenate(squares).mean())), 2)


def _round(value: float | None) -> float | None:
    return None if value is None else round(value, 4)


if __name__ == "__main__":
    try:
        print(json.dumps(measure_recording(tyro.cli(Options))))
    except InstDriveError as error:
        sys.exit(str(error))
