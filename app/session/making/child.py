"""Commands of ``instdrive`` in processes of their own: what fails or takes memory there does not harm the editor."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from instdrive_core.errors import InstDriveError

_NICENESS = 5
"""Lower priority of a job, so that the window stays smooth while all cores train."""


class CommandFailedError(InstDriveError):
    """A command ended with an error; the message is what it said."""


def run_command(*arguments: str) -> str:
    """Run a command to its end and return what it printed. Raises CommandFailedError with what it complained of."""
    done = subprocess.run(_build_command(arguments), capture_output=True, text=True, stdin=subprocess.DEVNULL)
    if done.returncode:
        raise CommandFailedError(clean_complaint(done.stderr))
    return done.stdout


def start_command(output: Path, *arguments: str) -> subprocess.Popen[bytes]:
    """Start a command that goes on when the editor ends; what it prints goes to the file `output`."""
    output.parent.mkdir(parents=True, exist_ok=True)
    with output.open("wb") as file:
        process = subprocess.Popen(
            _build_command(arguments),
            stdin=subprocess.DEVNULL,
            stdout=file,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        )
    if os.name == "posix":
        os.setpriority(os.PRIO_PROCESS, process.pid, _NICENESS)
    return process


def clean_complaint(text: str) -> str:
    """Find the sentence that a failed command ended with: its last line, without the command's name."""
    lines = [line for line in text.strip().splitlines() if line.strip()]
    if not lines:
        return "The command ended without a word"
    head, colon, rest = lines[-1].partition(": ")
    return rest if colon and head.startswith("instdrive") else lines[-1]


def _build_command(arguments: tuple[str, ...]) -> list[str]:
    return [sys.executable, "-m", "instdrive_app.main", *arguments]
