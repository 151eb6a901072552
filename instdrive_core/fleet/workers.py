"""Workers of a fleet on Ray: a process of its own for every attempt, on this machine or a cluster."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

from instdrive_core.errors import OptionError
from instdrive_core.fleet.clip_work import ClipOutcome, ClipTask, work_on_clip
from instdrive_core.fleet.reaper import start_reaper

_STORE_BYTES = 80 * 2**20
"""Ray's object store of a local fleet: nothing but tasks and outcomes goes through it."""


@dataclass(frozen=True)
class WorkerOptions:
    """What a clip is given, and where."""

    address: str | None = None
    """Address of a Ray cluster; None = this machine."""
    cpus: float = 2.0
    """Cores of a clip."""
    gpus: float = 0.0
    """GPUs of a clip."""


@runtime_checkable
class WorkerPool(Protocol):
    """What a driver asks of its workers."""

    def submit(self, task: ClipTask) -> None:
        """Have a task done once there is room."""
        ...

    def collect(self, seconds: float) -> list[tuple[ClipTask, ClipOutcome]]:
        """Collect tasks that ended, waiting up to some seconds for the first."""
        ...

    def stop(self) -> None:
        """Ask every task to stop where it can go on later; `collect` has their outcomes."""
        ...


class RayPool:
    """Workers on Ray."""

    def __init__(self, ray: Any, options: WorkerOptions) -> None:
        self._ray = ray
        self._running: dict[Any, ClipTask] = {}
        threads = str(max(int(options.cpus), 1))
        # A process does one task, so that memory is given back and a killed one takes nothing with it.
        # Retries are the driver's, which keeps their reasons.
        self._work = ray.remote(
            num_cpus=options.cpus,
            num_gpus=options.gpus,
            max_retries=0,
            max_calls=1,
            runtime_env={"env_vars": {"NUMBA_NUM_THREADS": threads, "OMP_NUM_THREADS": threads}},
        )(work_on_clip)

    def submit(self, task: ClipTask) -> None:
        """Have a task done once there is room."""
        self._running[self._work.remote(task)] = task

    def collect(self, seconds: float) -> list[tuple[ClipTask, ClipOutcome]]:
        """Collect tasks that ended, waiting up to some seconds for the first; lost workers are told as failures."""
        if not self._running:
            return []
        waiting = list(self._running)
        ready, _ = self._ray.wait(waiting, num_returns=1, timeout=seconds)
        if ready:
            ready, _ = self._ray.wait(waiting, num_returns=len(waiting), timeout=0)
        return [(self._running.pop(reference), self._find_outcome(reference)) for reference in ready]

    def stop(self) -> None:
        """Ask every task to stop where it can go on later."""
        for reference in self._running:
            self._ray.cancel(reference, force=False)

    def _find_outcome(self, reference: Any) -> ClipOutcome:
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference)
        except errors.TaskCancelledError:
            return ClipOutcome("stopped")
        except errors.OutOfMemoryError:
            return ClipOutcome("failed", "the worker was ended because its machine ran out of memory", may_repeat=True)
        except errors.RayError as error:
            reason = str(error).strip().split("\n")[0]
            return ClipOutcome("failed", f"the worker was lost ({type(error).__name__}: {reason})", may_repeat=True)


@contextmanager
def open_ray_pool(options: WorkerOptions) -> Iterator[RayPool]:
    """Start Ray on this machine, or join a cluster, and leave it at the end of the block.

    Raises OptionError where the cluster cannot be reached, or no machine has what a clip is given.
    """
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "1")  # a clip without a GPU sees none
    import ray

    local: dict[str, Any] = {
        "address": "local",  # else Ray would join a cluster that this machine belongs to
        "num_cpus": os.cpu_count(),
        "include_dashboard": False,
        "object_store_memory": _STORE_BYTES,
    }
    place: dict[str, Any] = local if options.address is None else {"address": options.address}
    if options.address is None:
        os.environ.pop("RAY_ADDRESS", None)
    try:
        ray.init(**place, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, RuntimeError, ValueError) as error:
        where = "on this machine" if options.address is None else f"at {options.address}"
        token = "" if options.address is None else ". Check the address, and that RAY_AUTH_TOKEN is the cluster's"
        raise OptionError(f"Ray cannot be started {where}: {error}{token}") from error
    reaper = start_reaper() if options.address is None else None
    try:
        with _interrupted_by_sigterm():
            _check_room(ray, options)
            yield RayPool(ray, options)
    finally:
        with contextlib.suppress(KeyboardInterrupt):
            ray.shutdown()
        if reaper is not None and reaper.stdin is not None:
            reaper.stdin.close()
            reaper.wait()


@contextmanager
def _interrupted_by_sigterm() -> Iterator[None]:
    """Let SIGTERM stop the driver as Ctrl+C does; Ray's own handler prints a stack and ends it."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(kind: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _check_room(ray: Any, options: WorkerOptions) -> None:
    """Check that a machine has what a clip is given: Ray would wait for ever."""
    machines = [node["Resources"] for node in ray.nodes() if node["Alive"]]

    def fits(machine: dict[str, float]) -> bool:
        return machine.get("CPU", 0) >= options.cpus and machine.get("GPU", 0) >= options.gpus

    if any(map(fits, machines)):
        return
    most = max((machine.get("CPU", 0) for machine in machines), default=0)
    gpus = max((machine.get("GPU", 0) for machine in machines), default=0)
    raise OptionError(
        f"no machine has {options.cpus:g} cores and {options.gpus:g} GPUs for a clip; the largest have {most:g} cores "
        f"and {gpus:g} GPUs. Lower --cpus-per-clip or --gpus-per-clip."
    )
