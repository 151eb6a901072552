"""Move a parked car along its lane, and put a copy of it beside, both standing on the ground."""

from __future__ import annotations

from scene_and_folder import scene_and_folder

from instdrive_core.edits.kinds.duplicate import DuplicateInstances
from instdrive_core.edits.kinds.move import MoveInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.edits.queries.placement import compute_center, find_lane
from instdrive_core.formats.registry import save_scene
from instdrive_core.project.open import open_document

path, folder = scene_and_folder()
document, _ = open_document(path)

parked = [i for i in document.scene.table if i.class_name == "Car" and not i.node]
car = max(parked, key=lambda instance: instance.count).id
center = compute_center(document, (car,), time=0.0)
x, y, _ = find_lane(document, (car,), center, time=0.0)

document.apply(MoveInstances((car,), translation=(3 * x, 3 * y, 0.0), along_lane=True, on_ground=True))
before = {instance.id for instance in document.scene.table}
document.apply(DuplicateInstances((car,), (-2.5 * y, 2.5 * x, 0.0)))
(copy,) = {instance.id for instance in document.scene.table} - before
document.apply(MoveInstances((copy,), rotation=(0.97, 0.0, 0.0, 0.24), yaw_only=True, on_ground=True))

save_scene(folder / "moved.spz", bake_document(document, time=0.0))
print(f"moved {document.scene.table[car].name} by 3 m, copied it to {document.scene.table[copy].name}: moved.spz")
