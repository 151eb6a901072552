"""A process that has imported the editor: each editor of the tests is a fork of it.

Importing takes half the time of opening a window. ``python seed_editor.py SOCKET`` takes orders from the socket with
that descriptor, see `seed`, until its other end closes. Nothing may start a thread before, as compiled
kernels would: a fork has none but its own, and waits for others for ever.
"""

import faulthandler
import json
import os
import runpy
import socket
import sys
from contextlib import suppress

import instdrive_app.cli.edit
import instdrive_app.session.editor_session
import instdrive_app.shell.window  # noqa: F401

LONGEST = 1 << 20
"""Bytes of an order."""


def serve(orders):
    """Start an editor for each order; returns in each editor with its order, and here as the other end closes."""
    while True:
        text, descriptors, _, _ = socket.recv_fds(orders, LONGEST, 2)
        with suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        if not text:
            return None
        answers, errors = descriptors
        if os.fork() == 0:
            orders.close()
            return _fork_editor(json.loads(text), answers, errors)
        os.close(answers)
        os.close(errors)


def _fork_editor(order, answers, errors):
    """Two processes: the editor, in which this returns, and one that tells how the editor ended."""
    editor = os.fork()
    if editor == 0:
        os.close(answers)
        os.dup2(errors, sys.stderr.fileno())
        os.close(errors)
        return order
    os.close(errors)
    with suppress(BrokenPipeError):
        os.write(answers, b"%d" % editor)
    _, status = os.waitpid(editor, 0)
    with suppress(BrokenPipeError):
        os.write(answers, b"%d" % os.waitstatus_to_exitcode(status))
    os._exit(0)


def run_editor(order):
    """Be the program of an order; ends the process."""
    os.chdir(order["folder"])
    os.environ.clear()
    os.environ.update(order["environment"])
    faulthandler.enable()
    program, *sys.argv[1:] = order["arguments"]
    sys.argv[0] = program
    runpy.run_path(program, run_name="__main__")


if __name__ == "__main__":
    assert len(os.listdir("/proc/self/task")) == 1, "a thread has been started"
    wanted = serve(socket.socket(fileno=int(sys.argv[1])))
    if wanted is not None:
        run_editor(wanted)
