"""What one camera records at one moment: colour, masks, depth, and how much of each thing it sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8, UInt16, UInt32
from numpy import ndarray

from instdrive_core.masks.export.coco_panoptic import measure_segments
from instdrive_core.rasterize.preview import Preview
from instdrive_core.rasterize.rolling_shutter import skew_scene, view_skewed
from instdrive_core.rasterize.scene_view import build_instance_map, view_scene
from instdrive_core.rasterize.silhouettes import Silhouettes, measure_silhouettes
from instdrive_core.recording.confidence import ConfidenceFacts, draw_confidence, summarize_confidence
from instdrive_core.recording.flow import FlowField, compute_flow
from instdrive_core.recording.shutter import RollingRig
from instdrive_core.recording.things import Thing
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.exposure import apply_exposure
from instdrive_core.scene.scene import Scene

COVERED = 0.5
"""Alpha from which a pixel has a depth."""


@dataclass(frozen=True)
class RecordedView:
    """One camera at one moment."""

    view: CameraView
    color: UInt8[ndarray, "h w 3"]
    instances: UInt32[ndarray, "h w"]
    """The editor's instance of each pixel, 0 for none."""
    classes: UInt16[ndarray, "h w"]
    """Number of each pixel's class, 0 for none or unknown."""
    depth: Float32[ndarray, "h w"]
    """Metres along the viewing axis; 0 where nothing is, such as in the sky."""
    objects: tuple[dict[str, Any], ...]
    """2D boxes and visibility of every instance that is seen, or would be with nothing in front."""
    flow: FlowField | None = None
    """Motion to the same camera's next picture; None where none was asked for, or there is no next one."""
    confidence: Float32[ndarray, "h w"] | None = None
    """Share of each pixel's weight from splats that enough photos saw; None where none was asked for."""
    confidence_facts: ConfidenceFacts | None = None


def number_classes(scene: Scene) -> dict[str, int]:
    """Number the classes of a scene's instances from 1, in the order of their names."""
    names = sorted({instance.class_name for instance in scene.table} - {""})
    return {name: number for number, name in enumerate(names, start=1)}


@dataclass(frozen=True)
class ViewRecorder:
    """Records views of one scene."""

    scene: Scene
    things: Sequence[Thing]
    """All boxed instances, as `find_boxed_things` gives them."""
    groups: Int32[ndarray, " n"]
    """Their splats, as `label_groups` gives them."""
    class_numbers: dict[str, int]
    """Numbers of classes, as `number_classes` gives them."""
    exposed: bool = False
    """Whether colours get the exposures of the training photos."""
    trusted: Bool[ndarray, " n"] | None = None
    """Splats that enough photos saw; None where no confidence is asked for."""
    rolling: RollingRig | None = None
    """The cameras as they move while their lines are exposed; None where all lines are exposed at once."""

    def record(self, view: CameraView, following: CameraView | None = None) -> RecordedView:
        """Record what a camera shows of the scene at the view's time, with the flow to the `following` view."""
        scene, shown = self._view(view)
        color = shown.color
        if self.exposed and scene.exposures is not None:
            color = apply_exposure(color, scene.exposures.interpolate(view.name, view.time))
        ids = build_instance_map(scene, shown)
        by_id = np.zeros(int(max(scene.table.instances, default=0)) + 1, np.uint16)
        for instance in scene.table:
            by_id[instance.id] = self.class_numbers.get(instance.class_name, 0)
        found = measure_silhouettes(scene, self.groups, len(self.things), view.camera, view.time)
        covered = shown.alpha >= COVERED
        depth = np.where(covered, shown.depth, np.float32(0))
        confidence = None if self.trusted is None else draw_confidence(scene, view, self.trusted)
        return RecordedView(
            view=view,
            color=np.round(np.clip(color, 0, 1) * 255).astype(np.uint8),
            instances=ids,
            classes=by_id[ids],
            depth=depth,
            objects=tuple(_describe_objects(scene, ids, self.things, found)),
            flow=None if following is None else compute_flow(scene, view, following, depth, shown.winner),
            confidence=confidence,
            confidence_facts=None if confidence is None else summarize_confidence(confidence, covered),
        )

    def _view(self, view: CameraView) -> tuple[Scene, Preview]:
        """The scene as the view's lines see it, and its picture."""
        if self.rolling is None:
            return self.scene, view_scene(self.scene, view.camera, view.time)
        camera = self.rolling.roll(view)
        skewed = skew_scene(self.scene, camera)
        return skewed, view_skewed(skewed, camera)


def _describe_objects(
    scene: Scene, ids: UInt32[ndarray, "h w"], things: Sequence[Thing], found: Silhouettes
) -> list[dict[str, Any]]:
    seen = {segment["id"]: segment for segment in measure_segments(ids)}
    places = {thing.instance.id: place for place, thing in enumerate(things)}
    listed = []
    for instance in scene.table:
        segment, place = seen.get(instance.id), places.get(instance.id)
        visible = segment["area"] if segment else 0
        whole = int(found.pixels[place]) if place is not None else 0
        if not visible and not whole:
            continue
        boxes = [segment["bbox"]] if segment else []
        if whole and place is not None:
            left, top, right, bottom = found.boxes[place].tolist()
            boxes.append([left, top, right - left, bottom - top])
        listed.append(
            {
                "id": instance.id,
                "name": instance.name,
                "class": instance.class_name,
                "box_visible": segment["bbox"] if segment else None,
                "box_amodal": _join_boxes(boxes) if place is not None else None,
                "pixels_visible": visible,
                "pixels_amodal": max(whole, visible) if place is not None else None,
                "visibility": round(visible / max(whole, visible), 4) if place is not None else None,
            }
        )
    return listed


def _join_boxes(boxes: list[list[int]]) -> list[int]:
    """The smallest box (x, y, width, height) around boxes."""
    left, top = min(box[0] for box in boxes), min(box[1] for box in boxes)
    right, bottom = max(box[0] + box[2] for box in boxes), max(box[1] + box[3] for box in boxes)
    return [left, top, right - left, bottom - top]
