"""``instdrive fleet``: many clips become measured scenes, side by side."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from tyro.conf import Positional, arg

from instdrive_core.errors import InstDriveError, OptionError
from instdrive_core.wording import format_count

if TYPE_CHECKING:
    from instdrive_core.fleet.records import ClipRecord


class ClipsFailedError(InstDriveError):
    """Some clips of a fleet have no scene."""


def train_fleet(
    clips: Positional[tuple[str, ...]],
    *,
    out: Annotated[str, arg(aliases=["-o"])],
    address: str | None = None,
    cpus_per_clip: float = 2.0,
    gpus_per_clip: float = 0.0,
    minutes: float = 20.0,
    iterations: int | None = None,
    no_eval: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    record: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False,
    retries: int = 2,
    checkpoint_every: int = 100,
    scratch: Path | None = None,
) -> None:
    """Make measured scenes of many clips side by side: masks, tracks, training, evaluation, recording.

    What was stopped or killed goes on where it was when the same command is given again.

    Args:
        clips: Folders of clips or photos, videos, or addresses of them such as s3://bucket/drives/002.
        out: Folder or address of the runs, one below it for each clip; its index.html shows them all.
        address: Ray cluster to work on, e.g. auto or ray://head:10001; default: this machine.
        cpus_per_clip: Cores that each clip is given.
        gpus_per_clip: GPUs that each clip is given; clips train on the CPU where it is 0.
        minutes: How long each clip may take; some training steps are timed to find out how many fit.
        iterations: Training steps of each clip, instead of as many as the minutes allow.
        no_eval: Leave the evaluation out.
        record: Record each trained drive again, as `instdrive simulate` does.
        retries: Tries after the first where a worker dies; a clip that is at fault is not tried again.
        checkpoint_every: Training steps between checkpoints: what a killed worker repeats at most.
        scratch: Folder on each worker's machine for clips and runs that have an address.
    """
    for package in ("ray", "fsspec", "torch"):
        if find_spec(package) is None:  # told before anything is written
            raise ModuleNotFoundError(name=package)
    from platformdirs import user_cache_path

    from instdrive_core.fleet.driver import FleetDriver, FleetOrder
    from instdrive_core.fleet.hold import hold_place
    from instdrive_core.fleet.page import PAGE
    from instdrive_core.fleet.place import open_place
    from instdrive_core.fleet.plan import ClipWishes, plan_fleet
    from instdrive_core.fleet.workers import WorkerOptions, open_ray_pool

    _check("minutes", minutes, 0 < minutes < 100_000, "more than 0")
    _check("iterations", iterations, iterations is None or iterations >= 1, "1 or more")
    _check("retries", retries, 0 <= retries <= 100, "0 to 100")
    _check("checkpoint-every", checkpoint_every, checkpoint_every >= 1, "1 or more")
    _check("cpus-per-clip", cpus_per_clip, 0 < cpus_per_clip < 10_000, "more than 0")
    _check("gpus-per-clip", gpus_per_clip, 0 <= gpus_per_clip < 10_000, "0 or more")
    planned = plan_fleet(clips)
    wishes = ClipWishes(minutes, iterations, not no_eval, record, checkpoint_every)
    folder = str((scratch or user_cache_path("instdrive") / "fleet").absolute())
    place = open_place(out)
    with hold_place(place) as hold:
        print(f"{format_count(len(planned), 'clip')}; see {place.root}/{PAGE}", flush=True)
        with open_ray_pool(WorkerOptions(address, cpus_per_clip, gpus_per_clip)) as pool:
            order = FleetOrder(planned, place, wishes, folder, retries)
            records = FleetDriver(order, pool, _print_change, hold.renew).run()
    failed = [each for each in records if each.status != "done"]
    if failed:
        reasons = "; ".join(f"{each.clip.name} ({each.problem or each.status})" for each in failed)
        raise ClipsFailedError(f"{len(failed)} of {format_count(len(records), 'clip')} failed: {reasons}")
    print(f"all {len(records)} done: {place.root}")


def _check(name: str, value: object, is_fine: bool, limits: str) -> None:
    if not is_fine:
        raise OptionError(f"--{name} is {value}; it must be {limits}")


def _print_change(record: ClipRecord) -> None:
    again = f" again: {record.attempts[-1].problem}" if record.status == "waiting" and record.attempts else ""
    reason = f": {record.problem}" if record.problem else ""
    print(f"{record.clip.name}: {record.status}{again}{reason}", flush=True)
