"""The LiDAR of a recording: the clip's own, as far as its sweeps show it, or a described one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Float64, Int64
from numpy import ndarray

from instdrive_core.datasets.clip import Sweep
from instdrive_core.errors import OptionError
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.progress import report_span
from instdrive_core.recording.run_clip import open_run_clip
from instdrive_core.recording.sweep_files import CastSweep, MomentSweep
from instdrive_core.scene.camera import CameraView
from instdrive_core.scene.scene import Scene
from instdrive_core.sweeps.cast import RayCaster
from instdrive_core.sweeps.drops import RayDrop, learn_drop
from instdrive_core.sweeps.intensity import learn_intensities
from instdrive_core.sweeps.offsets import learn_offsets
from instdrive_core.sweeps.pattern import Pattern, trace_pattern
from instdrive_core.sweeps.place import find_sensor_place
from instdrive_core.sweeps.rig import Rig, build_rig
from instdrive_core.sweeps.sensor import NONE, OWN, find_sensor


@dataclass(frozen=True)
class Lidar:
    """A sensor and what is known of how surfaces return its light."""

    find_pattern: Callable[[float], Pattern]
    """Where it looks in the sweep of a moment, seconds."""
    intensities: Float32[ndarray, " n"]
    """By splat of the edited scene."""
    offsets: Float32[ndarray, " n"] | None = None
    """By splat, metres from where it is densest to its surface; None where no sweep says it."""
    drop: RayDrop | None = None
    """How often its rays are lost, by splat of the edited scene; None: none is."""
    notes: tuple[str, ...] = ()
    """What the user should know."""


def choose_lidar(
    name: str | None, run: Path | None, opened: Scene, rows: Int64[ndarray, " n"], ray_drop: bool = False
) -> Lidar | None:
    """Choose the LiDAR that is asked for; None for none.

    Args:
        name: `own`, `none`, a sensor of `sweeps.sensor.SENSORS`, or a JSON file; None is the clip's own where its
            sweeps are at hand.
        run: folder of the run, which names its clip; None where the scene is no longer in its clip's world.
        opened: the scene with what edits added, nothing moved or deleted.
        rows: row of `opened` for each splat of the edited scene.
        ray_drop: whether surfaces lose rays as often as in the clip's sweeps.

    Raises OptionError where `own` or ray drop is asked for and no sweeps are at hand.
    """
    if name == NONE:
        return None
    clip, problem = (None, "") if run is None else open_run_clip(run, opened)
    has_sweeps = clip is not None and len(clip.training_sweeps) > 0
    if name in (None, OWN) and not has_sweeps:
        if name is None:
            return None
        raise OptionError(f"there are no sweeps to learn the own LiDAR from: {problem or 'the clip has none'}")
    if ray_drop and not has_sweeps:
        raise OptionError(f"there are no sweeps to learn the ray drop from: {problem or 'the clip has none'}")
    notes = []
    described = None if name in (None, OWN) else find_sensor(name)
    if clip is None or not has_sweeps:
        intensities = np.zeros(len(rows), np.float32)
        notes.append("the run's sweeps are not at hand: the LiDAR's intensity is 0 everywhere")
        return Lidar(lambda _: described or find_sensor(OWN), intensities, notes=tuple(notes))
    with report_span(0.0, 0.3):
        intensities = learn_intensities(opened, clip)[rows]
    rig, caster = build_rig([frame.view for frame in clip.frames]), RayCaster(opened)
    sweeps = clip.training_sweeps
    place = find_sensor_place(rig, sweeps)
    with report_span(0.3, 0.6 if ray_drop else 1.0):
        offsets = learn_offsets(caster, rig, sweeps, place)[rows]
    drop = None
    if ray_drop:
        with report_span(0.6, 1.0):
            drop = learn_drop(caster, rig, sweeps, place)
        if described is None:
            described = drop.grid
        drop = drop.of_rows(rows)
    find = _trace_own(rig, sweeps, place) if described is None else lambda _: described
    return Lidar(find, intensities, offsets, drop, tuple(notes))


def build_sweep_caster(scene: Scene, lidar: Lidar, views: Sequence[CameraView]) -> CastSweep:
    """Build what casts the sweep of a time step into the edited scene; equal steps give equal sweeps.

    Args:
        scene: the edited scene, with its tracks.
        lidar: the sensor.
        views: of all cameras of the rig, on the way that the recording car takes.
    """
    rig, casters = build_rig(views), {}

    def cast(step: int, moment: float) -> MomentSweep:
        pattern = lidar.find_pattern(moment)
        key = (pattern.near, pattern.far)
        if key not in casters:
            casters[key] = RayCaster(scene, *key, offsets=lidar.offsets)
        return cast_pattern(casters[key], pattern, rig, moment, lidar.intensities, step, lidar.drop)

    return cast


def cast_pattern(
    caster: RayCaster,
    pattern: Pattern,
    rig: Rig,
    moment: float,
    intensities: Float32[ndarray, " n"],
    number: int,
    drop: RayDrop | None = None,
) -> MomentSweep:
    """Cast one sweep of a sensor; rays that meet nothing give no point.

    Args:
        caster: of the scene.
        pattern: the sweep.
        rig: carries the sensor.
        moment: of the sweep, seconds.
        intensities: by splat of the scene.
        number: of the sweep; equal numbers give equal noise and lose equal rays.
        drop: how often splats of the scene lose rays; None: never.
    """
    scene, rays = caster.scene, pattern.aim(rig, moment)
    returns = caster.cast(rays)
    met = np.flatnonzero(np.isfinite(returns.ranges) if drop is None else drop.draw_kept(returns, number))
    ranges = returns.ranges[met].astype(np.float64)
    if pattern.noise:
        ranges += make_generator(0, Stream.LIDAR_NOISE, number).normal(0, pattern.noise, len(met))
    rows = returns.rows[met]
    pose = np.eye(4)
    places, turns = rig.place(np.array([moment]))
    pose[:3, :3], pose[:3, 3] = turns[0], places[0] + turns[0] @ pattern.place
    return MomentSweep(
        points=(rays.origins[met] + ranges[:, None] * rays.directions[met]).astype(np.float32),
        intensity=intensities[rows],
        times=rays.times[met],
        instances=scene.instance_ids[rows],
        world_from_lidar=pose,
    )


def _trace_own(rig: Rig, sweeps: Sequence[Sweep], place: Float64[ndarray, "3"]) -> Callable[[float], Pattern]:
    """The pattern of the clip's nearest sweep that may train; the last one is kept."""
    kept: dict[int, Pattern] = {}

    def find(moment: float) -> Pattern:
        nearest = min(sweeps, key=lambda sweep: abs(sweep.time - moment))
        if nearest.index not in kept:
            kept.clear()
            kept[nearest.index] = trace_pattern(rig, nearest.time, nearest.load(), place)
        return kept[nearest.index]

    return find
