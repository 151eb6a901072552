"""A project keeps the edits, not the splats: save, open again, undo, redo."""

from __future__ import annotations

from scene_and_folder import scene_and_folder

from instdrive_core.edits.kinds.color import RecolorInstances
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.project.open import open_document
from instdrive_core.project.save import save_project

path, folder = scene_and_folder()
project = folder / "session.instdrive"

document, _ = open_document(path)
first, second = sorted(document.scene.table, key=lambda instance: instance.count)[-2:]
document.apply(DeleteInstances((first.id,)))
document.apply(RecolorInstances((second.id,), "solid", (0.9, 0.5, 0.1)))
save_project(project, document)
print(f"{project.stat().st_size:,} bytes hold {len(document.history.edits)} edits")

again, _ = open_document(project)
assert again.find_visible_instances() == document.find_visible_instances()
again.undo()
again.undo()
assert first.id in again.find_visible_instances()
redone = again.redo()
assert redone is not None
print(f"opened again, undone and redone: {redone.title}")
