"""Parts of a scene as scenes of their own: some of its splats, or one actor in its box's frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from instdrive_core.edits.document.document import Document
from instdrive_core.edits.queries.bake import bake_document, recount_table
from instdrive_core.errors import EditError
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.selection import Flag
from instdrive_core.wording import phrase


def find_selected_rows(document: Document) -> Int[ndarray, " k"]:
    """The selected splats that are left. Raises EditError where nothing is selected."""
    rows = document.state.find_rows(Flag.SELECTED)
    rows = rows[~document.state.find_mask(Flag.DELETED)[rows]]
    if not len(rows):
        raise EditError("nothing is selected; select what to export first")
    return rows


def bake_part(document: Document, rows: Int[ndarray, " k"], time: float | None = None) -> Scene:
    """Some splats (rising) as a scene: edited as by `bake_document`, with no sky and only the tracks of these splats.

    With a `time` (seconds) actors stand where they are then, and are left out where they are not there.
    """
    part = replace(bake_document(document, time, rows), sky=None)
    kept = np.unique(part.nodes[part.nodes > 0])
    new_nodes = np.zeros(len(part.actors) + 1, np.uint16)
    new_nodes[kept] = np.arange(1, len(kept) + 1)
    actors = tuple(part.actors[node - 1] for node in kept.tolist())
    return recount_table(replace(part, nodes=new_nodes[part.nodes], actors=actors))


def bake_actor(document: Document, node: int) -> Scene:
    """Bake what is left of an actor in its box's frame (x right, y forward, z up, metres, origin in the box's centre).

    A static scene of background splats: with the track's pose of a time, it stands where the actor stands then.
    Raises EditError where the scene has no such actor, or all of it is deleted.
    """
    scene = document.scene
    if not 1 <= node <= len(scene.actors):
        raise EditError(
            phrase("the scene has no actor {node}; it has {count}, counted from 1", node=node, count=len(scene.actors))
        )
    rows = np.flatnonzero((scene.nodes == node) & ~document.state.find_mask(Flag.DELETED))
    if not len(rows):
        raise EditError(
            phrase("nothing is left of actor {node}, the {label}", node=node, label=scene.actors[node - 1].label)
        )
    part = bake_document(document, None, rows)
    nodes = np.zeros(len(part), np.uint16)
    return recount_table(
        replace(part, nodes=nodes, actors=(), sky=None, views=(), exposures=None, origin=np.zeros(3)),
    )


def find_remaining_actors(document: Document) -> tuple[int, ...]:
    """Nodes of the actors of which anything is left, from 1."""
    left = document.scene.nodes[~document.state.find_mask(Flag.DELETED)]
    return tuple(np.unique(left[left > 0]).tolist())


def find_selected_actors(document: Document) -> tuple[int, ...]:
    """Nodes of the actors with any selected splat, from 1."""
    nodes = document.scene.nodes[document.state.find_rows(Flag.SELECTED)]
    return tuple(np.unique(nodes[nodes > 0]).tolist())
