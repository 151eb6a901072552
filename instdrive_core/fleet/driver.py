"""The driver of a fleet: hands clips to workers, tries again what died, and writes what there is to see."""

from __future__ import annotations

import time
import uuid
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

from instdrive_core.errors import DataError
from instdrive_core.fleet.clip_work import ClipOutcome, ClipTask
from instdrive_core.fleet.figures import (
    is_clip_finished,
    read_clip_figures,
    read_clip_picture,
    read_worker_token,
)
from instdrive_core.fleet.page import PAGE, build_fleet_page, embed_picture
from instdrive_core.fleet.place import FleetPlace
from instdrive_core.fleet.plan import ClipWishes, FleetClip
from instdrive_core.fleet.records import ClipRecord, read_records, write_records
from instdrive_core.fleet.workers import WorkerPool

_LOOK_SECONDS = 2.0
_STOP_SECONDS = 60.0
"""Time that workers have to write a checkpoint when the driver is stopped."""


@dataclass(frozen=True)
class FleetOrder:
    """What a driver is to do."""

    clips: tuple[FleetClip, ...]
    place: FleetPlace
    wishes: ClipWishes
    scratch: str
    """Folder of the workers' machines for what has an address."""
    retries: int = 2
    """Tries after the first for a clip whose worker died; a clip that is at fault is not tried again."""


@dataclass
class FleetDriver:
    """Works on an order; `records` say how far it is."""

    order: FleetOrder
    pool: WorkerPool
    on_change: Callable[[ClipRecord], None] = lambda record: None
    """Is told each clip whose status changed."""
    on_look: Callable[[], None] = lambda: None
    """Is called every few seconds."""
    records: dict[str, ClipRecord] = field(default_factory=dict)
    _tokens: dict[str, str] = field(default_factory=dict)
    _failures: Counter[str] = field(default_factory=Counter)

    def run(self) -> tuple[ClipRecord, ...]:
        """Do what is left of every clip, and return how all ended.

        An exception that ends the driver, Ctrl+C above all, stops the workers first, where they can go on later.
        """
        order = self.order
        self.records = {record.clip.name: record for record in read_records(order.place, order.clips)}
        for clip in order.clips:
            record = self.records[clip.name]
            if is_clip_finished(order.place, record.clip, order.wishes):
                self._change(replace(record, status="done"))
            else:
                self._submit(record.clip)
        try:
            while self._tokens:
                self._show("running")
                self.on_look()
                for task, outcome in self.pool.collect(_LOOK_SECONDS):
                    self._take(task, outcome)
                self._find_begun()
        except BaseException:
            self._stop()
            raise
        self._show("done")
        return tuple(self.records[clip.name] for clip in order.clips)

    def _submit(self, clip: FleetClip) -> None:
        order, token = self.order, uuid.uuid4().hex
        self._tokens[clip.name] = token
        self.pool.submit(ClipTask(clip, order.wishes, order.place.root, order.scratch, token))

    def _take(self, task: ClipTask, outcome: ClipOutcome) -> None:
        name = task.clip.name
        if self._tokens.pop(name, None) is None:
            return
        record = self.records[name]
        if outcome.status == "failed":
            self._failures[name] += 1
            record = record.add_attempt(outcome.problem, time.time())
            if outcome.may_repeat and self._failures[name] <= self.order.retries:
                self._change(replace(record, status="waiting"))
                self._submit(task.clip)
                return
        self._change(replace(record, status=outcome.status))

    def _find_begun(self) -> None:
        for name, token in self._tokens.items():
            record = self.records[name]
            if record.status == "waiting" and read_worker_token(self.order.place, record.clip) == token:
                self._change(replace(record, status="running"))

    def _stop(self) -> None:
        self.pool.stop()
        end = time.monotonic() + _STOP_SECONDS
        while self._tokens and time.monotonic() < end:
            for task, outcome in self.pool.collect(_LOOK_SECONDS):
                name = task.clip.name
                self._tokens.pop(name, None)
                self._change(replace(self.records[name], status="done" if outcome.status == "done" else "stopped"))
        for name in self._tokens:
            self._change(replace(self.records[name], status="stopped"))
        try:
            self._show("stopped")
        except DataError:
            return  # the error that stopped the driver says more

    def _change(self, record: ClipRecord) -> None:
        self.records[record.clip.name] = record
        self.on_change(record)

    def _show(self, status: str) -> None:
        """Write `fleet.json` and the page."""
        place, records = self.order.place, tuple(self.records.values())
        figures = [read_clip_figures(place, record.clip) for record in records]
        pictures = [embed_picture(read_clip_picture(place, record.clip)) for record in records]
        write_records(place, status, records, [asdict(each) for each in figures])
        page = build_fleet_page(records, figures, pictures, status == "running", time.time())
        place.write(PAGE, page.encode())
