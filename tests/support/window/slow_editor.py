"""The editor on a machine that reads scenes slowly: a sketch of 2,000 splats, and the whole once a file is there.

``python slow_editor.py ARGUMENTS`` takes those of `instdrive`; the file is called `GO` and lies beside the scene.
"""

import sys
import time
from functools import partial

from instdrive_app.main import main
from instdrive_app.session.files import opening
from instdrive_core.formats.registry import sketch_scene
from instdrive_core.progress import report

GO = "go"


def _read_slowly(path, **options):
    while not (path.parent / GO).exists():
        report(0.25)
        time.sleep(0.01)
    return _open_document(path, **options)


_open_document = opening.open_document

if __name__ == "__main__":  # a test that imports `GO` reads at its usual speed
    opening.open_document, opening.sketch_scene = _read_slowly, partial(sketch_scene, most=2000)
    sys.exit(main())
