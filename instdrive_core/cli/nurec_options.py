"""What ``instdrive apply`` takes from NVIDIA NuRec, and hands over to it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.edit import Edit
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.kinds.insert import InsertScene
from instdrive_core.errors import DataError
from instdrive_core.formats.nurec.edit_assets import NAME, AssetEdits, read_asset_edits
from instdrive_core.formats.nurec.objects import find_asset, read_object
from instdrive_core.formats.nurec.sequence_tracks import SequenceTracks, read_sequence_tracks
from instdrive_core.project.nurec import describe_hand_over, export_hand_over
from instdrive_core.scene.track import Track
from instdrive_core.wording import format_count


@dataclass(frozen=True)
class NurecOptions:
    """Edits of actors, exchanged with NVIDIA NuRec."""

    nurec_edits: Path | None = None
    """Folder with edit-assets.json and external_assets: its edits are done first."""
    nurec: Path | None = None
    """New folder to write edit-assets.json and external_assets into: the edits as NuRec's renderer takes them."""
    nurec_tracks: Path | None = None
    """sequence_tracks.json of NuRec's reconstruction of this drive, or its .usdz: whose actors and times are meant. The
    scene's second 0 is the first time in it. Default: the scene's own IDs, second 0 is 0."""

    def read_edits(self, document: Document) -> list[Edit]:
        """Build the edits of the folder. Raises DataError where it cannot be used."""
        if self.nurec_edits is None:
            return []
        told = read_asset_edits(self.nurec_edits / NAME)
        return build_edits(document, self.nurec_edits, told, self._read_tracks())

    def write(self, document: Document) -> None:
        """Write the folder of `nurec`, and say what NuRec cannot be told."""
        if self.nurec is None:
            return
        print(f"{self.nurec}: {describe_hand_over(export_hand_over(document, self.nurec, self.nurec_tracks))}")

    def _read_tracks(self) -> SequenceTracks | None:
        return None if self.nurec_tracks is None else read_sequence_tracks(self.nurec_tracks)


def build_edits(document: Document, folder: Path, told: AssetEdits, known: SequenceTracks | None) -> list[Edit]:
    """Build edits that do what NuRec's renderer would do; IDs that no actor has are passed over, and printed.

    Args:
        document: whose actors are meant.
        folder: holds `external_assets`.
        told: the edits.
        known: tracks of NuRec's reconstruction; None where IDs and times are the document's own.

    Raises DataError where an object is missing or damaged.
    """
    scene = document.scene
    actors = {track.id: (node, track) for node, track in enumerate(scene.actors, 1)}
    gone = [*told.removed, *(one.original for one in told.replaced)]
    unknown = [name for name in gone if name not in actors]
    if unknown:
        print(f"{folder / NAME}: no actor is called {', '.join(sorted(unknown)[:8])}; passed over")
    nodes = {actors[name][0] for name in gone if name in actors}
    ids = tuple(entry.id for entry in scene.table if entry.node in nodes)
    shown = [(one.asset, actors[one.original][1], one.original) for one in told.replaced if one.original in actors]
    zero = 0 if known is None else known.start
    for asset, track in told.inserted:
        poses = track.world_from_box.copy()
        poses[:, :3, 3] -= scene.origin
        times = track.times + (told.start - zero) / 1e6
        shown.append((asset, replace(track, times=times, world_from_box=poses), track.id))
    sources = [read_object(find_asset(folder, asset), _rename(track, name)) for asset, track, name in shown]
    steps: list[Edit] = [DeleteInstances(ids)] if ids else []
    steps += [
        InsertScene.from_scene(source, str(find_asset(folder, asset)))
        for source, (asset, _, _) in zip(sources, shown, strict=True)
    ]
    if not steps:
        raise DataError(folder / NAME, "none of its edits concerns this scene", "Check that it is of this drive")
    print(f"{folder / NAME}: {format_count(len(nodes), 'actor')} taken away, {len(sources)} put in")
    return steps


def _rename(track: Track, name: str) -> Track:
    return replace(track, id=name, world_from_box=np.ascontiguousarray(track.world_from_box))
