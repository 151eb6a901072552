"""Split the largest instance that is in several parts, name the parts, merge them again."""

from __future__ import annotations

from scene_and_folder import scene_and_folder

from instdrive_core.edits.kinds.merge import MergeInstances
from instdrive_core.edits.kinds.rename import RenameInstance
from instdrive_core.edits.kinds.split import SplitInstance
from instdrive_core.errors import EditError
from instdrive_core.project.open import open_document
from instdrive_core.project.save import save_project

path, folder = scene_and_folder()
document, _ = open_document(path)
table = document.scene.table

for instance in sorted(table, key=lambda instance: instance.count, reverse=True):
    before = {entry.id for entry in table}
    try:
        document.apply(SplitInstance(instance.id))
    except EditError as error:  # one part only, or fixed by something else: say so and try the next
        print(error)
        continue
    parts = sorted({entry.id for entry in table} - before)
    if parts:
        break
else:
    raise SystemExit("every instance hangs together")

print(f"{instance.name} ({instance.count:,} splats) splits into itself and {len(parts)} parts")
for number, part in enumerate(parts, start=1):
    document.apply(RenameInstance(part, f"{instance.name}, part {number}"))
document.apply(MergeInstances((instance.id, *parts), into=instance.id))
print(f"merged again: {table[instance.id].count:,} splats")
save_project(folder / "labels.instdrive", document)
print(f"the steps are in {folder / 'labels.instdrive'}; open it in the editor to undo them")
