"""A virtual display by Xvfb, for scripted sessions and tests."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager

from instdrive_app.shell.display import DisplayError

START_SECONDS = 20


@contextmanager
def open_virtual_display(size: tuple[int, int] = (1280, 720)) -> Iterator[str]:
    """Run Xvfb while the block runs; yields its name, e.g. ``:99``, and sets DISPLAY to it.

    Raises DisplayError where Xvfb is missing or does not start.
    """
    if shutil.which("Xvfb") is None:
        raise DisplayError("there is no display, and Xvfb is not installed; install it (Debian: apt install xvfb)")
    reader, writer = os.pipe()
    screen = f"{size[0]}x{size[1]}x24"
    command = ["Xvfb", "-displayfd", str(writer), "-screen", "0", screen, "-nolisten", "tcp", "-noreset"]
    process = subprocess.Popen(command, pass_fds=(writer,), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    os.close(writer)
    before = os.environ.get("DISPLAY")
    try:
        with os.fdopen(reader) as numbers:
            number = numbers.readline().strip()
        if not number:
            raise DisplayError(f"Xvfb ended with status {process.wait(START_SECONDS)} before it had a display")
        os.environ["DISPLAY"] = f":{number}"
        yield os.environ["DISPLAY"]
    finally:
        if before is None:
            os.environ.pop("DISPLAY", None)
        else:
            os.environ["DISPLAY"] = before
        process.terminate()
        process.wait(START_SECONDS)
