"""Delete the parked cars, take their strays away, and fill the ground that no photo showed with ground from around."""

from __future__ import annotations

from scene_and_folder import scene_and_folder

from instdrive_core.edits.deletions.deletion_report import report_deletion
from instdrive_core.edits.kinds.delete import DeleteInstances
from instdrive_core.edits.queries.bake import bake_document
from instdrive_core.formats.registry import save_scene
from instdrive_core.project.open import open_document

MOST = 3
"""Cars to remove; a fill looks for fitting ground, which takes a second each."""

path, folder = scene_and_folder()
document, _ = open_document(path)

parked = [i for i in document.scene.table if i.class_name == "Car" and not i.node]
for car in sorted(parked, key=lambda instance: instance.count, reverse=True)[:MOST]:
    document.apply(DeleteInstances((car.id,)))
    report = report_deletion(document, (car.id,), time=0.0)
    print(f"{car.name}: {report.summary}")
    for edit in (report.make_absorb_edit(), *report.make_fill_edits()):
        if edit is not None:
            document.apply(edit)
    print(f"  then: {report_deletion(document, (car.id,), time=0.0).summary}")

out = folder / "cleared.ply"
result = bake_document(document, time=0.0)
save_scene(out, result)
print(f"{out}: {len(result):,} splats, {int(result.extra['synthetic'].sum()):,} of them synthetic")
