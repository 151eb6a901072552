"""Starts editors as forks of one process that has imported all they need: see `seed_editor`."""

import atexit
import json
import os
import select
import signal
import socket
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

PROGRAM = Path(__file__).with_name("seed_editor.py")
LONGEST_ANSWER = 32
"""Bytes of a number."""


class SeededProcess:
    """A running editor, with what tests ask of a `subprocess.Popen`."""

    def __init__(self, program, arguments, environment, errors):
        """Run a script with these arguments; what it writes to its standard error goes into the file `errors`."""
        order = {"arguments": [str(program), *map(str, arguments)], "environment": environment, "folder": os.getcwd()}
        self._answers, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            text = json.dumps(order).encode()
            socket.send_fds(_start_seed(), [text], [theirs.fileno(), errors.fileno()])
        self.pid = int(self._answers.recv(LONGEST_ANSWER))
        self.returncode = None

    def poll(self):
        """The exit status, negative after a signal, or None while it runs."""
        return self._look(0.0)

    def wait(self, timeout):
        """The exit status; raises TimeoutError where it still runs after so many seconds."""
        if self._look(timeout) is None:
            raise TimeoutError(f"the editor still runs after {timeout:g} s")
        return self.returncode

    def send_signal(self, number):
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self):
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self):
        """End it."""
        self.send_signal(signal.SIGKILL)

    def _look(self, patience):
        end = time.monotonic() + patience
        while self.returncode is None:
            if select.select([self._answers], [], [], max(0.0, end - time.monotonic()))[0]:
                self.returncode = int(self._answers.recv(LONGEST_ANSWER))
                self._answers.close()
            elif time.monotonic() >= end:
                break
        return self.returncode


@cache
def _start_seed():
    """The socket of this process's seed, which ends with this process."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with theirs:
        number = theirs.fileno()
        alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}  # else importing NumPy starts threads
        seed = subprocess.Popen([sys.executable, str(PROGRAM), str(number)], pass_fds=[number], env=alone)

    def end():
        ours.close()
        seed.wait()

    atexit.register(end)
    return ours
