"""Edits of actors handed to NuRec, and taken back: the same actors stand in the same places."""

import dataclasses
import json

import numpy as np
import pytest
from random_scene import random_scene

from instdrive_core.cli.apply import apply
from instdrive_core.cli.edit_options import EditOptions
from instdrive_core.cli.nurec_options import NurecOptions
from instdrive_core.errors import DataError, UntrustedDataError
from instdrive_core.formats.nurec.edit_assets import AssetEdits, read_asset_edits, write_asset_edits
from instdrive_core.formats.nurec.hand_over import plan_hand_over
from instdrive_core.formats.nurec.objects import find_asset
from instdrive_core.formats.nurec.sequence_tracks import SequenceTracks, write_sequence_tracks
from instdrive_core.formats.ply.inria import read_ply
from instdrive_core.formats.registry import open_scene, save_scene

TAKEN, MOVED, PAINTED = 7, 8, 9
"""Instances of three actors."""


@pytest.fixture
def scene(tmp_path):
    made = dataclasses.replace(random_scene(4, 400, actors=3, features=0), sky=None)
    save_scene(tmp_path / "street", made)
    return tmp_path / "street"


def edit(scene, out, folder, **more):
    exchange = NurecOptions(nurec=folder, **more)
    changes = EditOptions(move=(f"{MOVED}=3,1,0",), duplicate=("1=0,6,0",))
    apply(
        scene,
        out=out,
        delete=(TAKEN, 2),
        recolor=(f"{PAINTED}=#d02020",),
        recolor_mode="solid",
        more=changes,
        exchange=exchange,
    )


def rows_of(scene, name):
    node = 1 + next(row for row, track in enumerate(scene.actors) if track.id == name)
    return scene.gaussians.select(scene.nodes == node), scene.actors[node - 1]


def test_each_edit_becomes_what_nurec_knows(scene, tmp_path, capsys):
    edit(scene, tmp_path / "edited", tmp_path / "handed")
    told = read_asset_edits(tmp_path / "handed" / "edit-assets.json")
    assert told.removed == ("actor-0", "actor-1")
    (painted,) = told.replaced
    assert painted.original == "actor-2"
    assert next(track.id for _, track in told.inserted) == "actor-1_edited"
    assert len(told.inserted) == 2, "the moved actor and the copy of a parked thing"
    said = capsys.readouterr().out
    assert "2 removed, 1 replaced, 2 inserted" in said
    assert "1 still thing deleted" in said
    metadata = json.loads((tmp_path / "handed" / "external_assets" / "metadata.yaml").read_text())
    assert set(metadata["assets"]) == {"actor-1", "actor-2", told.inserted[1][0]}


def test_objects_lie_in_their_boxes_with_x_ahead(scene, tmp_path):
    edit(scene, tmp_path / "edited", tmp_path / "handed")
    after, _ = rows_of(open_scene(tmp_path / "edited"), "actor-1")
    file = tmp_path / "handed" / "external_assets" / "actor-1" / "actor-1.ply"
    found = read_ply(file).gaussians.means
    np.testing.assert_allclose(found[:, 0], after.means[:, 1], atol=1e-5)
    np.testing.assert_allclose(found[:, 1], -after.means[:, 0], atol=1e-5)


def test_taken_back_the_actors_are_those_of_the_edited_scene(scene, tmp_path):
    edit(scene, tmp_path / "edited", tmp_path / "handed")
    apply(scene, out=tmp_path / "back", exchange=NurecOptions(nurec_edits=tmp_path / "handed"))
    edited, back = open_scene(tmp_path / "edited"), open_scene(tmp_path / "back")
    painted, track = rows_of(edited, "actor-2")
    again, same = rows_of(back, next(t.id for t in back.actors if t.id.startswith("actor-2") and _has_rows(back, t.id)))
    np.testing.assert_allclose(again.sh_dc, painted.sh_dc, atol=1e-6)
    np.testing.assert_allclose(again.means, painted.means, atol=1e-5)
    np.testing.assert_allclose(same.world_from_box, track.world_from_box, atol=1e-6)
    moved, track = rows_of(edited, "actor-1")
    again, same = rows_of(back, "actor-1_edited")
    np.testing.assert_allclose(again.means, moved.means, atol=1e-5)
    np.testing.assert_allclose(same.world_from_box[:, :3, 3], track.world_from_box[:, :3, 3], atol=1e-4)
    np.testing.assert_allclose(same.times, track.times, atol=1e-6)
    assert not _has_rows(back, "actor-0")


def _has_rows(scene, name):
    return any(track.id == name and (scene.nodes == node).any() for node, track in enumerate(scene.actors, 1))


def test_actors_are_found_by_place_where_nurec_names_them_otherwise(scene, tmp_path):
    made = open_scene(scene)
    start = 1_700_000_000_000_000
    theirs = []
    for track in made.actors[:2]:
        poses = track.world_from_box.copy()
        poses[:, :3, 3] += made.origin + np.array([0.2, 0, 0])
        theirs.append(dataclasses.replace(track, id=f"nurec {track.id}", world_from_box=poses))
    write_sequence_tracks(tmp_path / "tracks.json", SequenceTracks(tuple(theirs), start))
    first = min(track.times[0] for track in made.actors[:2])
    later = (dataclasses.replace(track, times=track.times - first) for track in made.actors)
    save_scene(tmp_path / "shifted", dataclasses.replace(made, actors=tuple(later)))
    edit(tmp_path / "shifted", tmp_path / "edited", tmp_path / "handed", nurec_tracks=tmp_path / "tracks.json")
    told = read_asset_edits(tmp_path / "handed" / "edit-assets.json")
    assert told.removed == ("nurec actor-0", "nurec actor-1")
    assert told.start >= start


def test_nothing_changed_hands_over_nothing(scene):
    made = open_scene(scene)
    plan = plan_hand_over(made, open_scene(scene))
    assert (plan.edits, plan.objects, plan.untold) == (AssetEdits(), {}, ())


def test_a_folder_that_is_there_is_not_written_over(scene, tmp_path):
    edit(scene, tmp_path / "edited", tmp_path / "handed")
    with pytest.raises(DataError, match="already"):
        edit(scene, tmp_path / "edited2", tmp_path / "handed")


@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "a/b", ".."])
def test_assets_outside_of_the_folder_are_refused(tmp_path, name):
    with pytest.raises(UntrustedDataError, match="is a path"):
        find_asset(tmp_path, name)


def test_edits_of_another_drive_say_so(scene, tmp_path):
    write_asset_edits(tmp_path / "edit-assets.json", AssetEdits(removed=("nobody",)))
    with pytest.raises(DataError, match="none of its edits"):
        apply(scene, out=tmp_path / "back", exchange=NurecOptions(nurec_edits=tmp_path))
