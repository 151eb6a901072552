"""What tests of an `EditorSession` share: waiting as a window's frames do, and what the user was told."""

import time

from instdrive_app.messages import Level


def finish(session, seconds=240):
    """Frames until no job is left, neither in the queue nor aside."""
    end = time.monotonic() + seconds
    while session.jobs.current is not None:
        assert time.monotonic() < end, f"{session.jobs.current.title} takes more than {seconds} s"
        session.tick(0.0)
        time.sleep(0.002)


def errors(session):
    """The errors that the user was told."""
    return [message.text for message in session.messages.log if message.level is Level.ERROR]
