"""Synthetic streets that several files of tests train on: each is rendered once in a run of the suite, which takes
seconds, and copied for whoever wants it."""

import hashlib
import os
import shutil
import time

from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street
from instdrive_core.files.file_lock import FileLock

TINY = StreetConfig(seed=3, steps=5, width=64, height=36, lidar_azimuths=200)
SMALL = StreetConfig(seed=3, steps=5, width=96, height=54, lidar_azimuths=300)
"""Five steps each, of which step 4 is held out."""


def copy_street(config, folder, factory):
    """A street in a folder of the caller's own, which is returned; `factory`: the fixture `tmp_path_factory`."""
    base = factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base  # by all workers of the run
    kept = shared / f"street-{hashlib.sha256(repr(config).encode()).hexdigest()[:12]}"
    while (lock := FileLock.acquire(kept.with_suffix(".lock"))) is None:
        time.sleep(0.02)
    try:
        if not kept.exists():
            unfinished = kept.with_suffix(".unfinished")
            write_street(unfinished, config)
            unfinished.rename(kept)
    finally:
        lock.release()
    shutil.copytree(kept, folder)
    return folder
