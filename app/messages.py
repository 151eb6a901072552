"""Messages to the user: kept in the log, shown for some seconds as toasts."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum

from instdrive_core.wording import Phrase, begin_sentence

TOAST_SECONDS = {"info": 4.0, "error": 10.0}
"""For how long a toast is shown at least …"""
READING_SECONDS = 0.06
"""… and for each of its characters, at which most people read it once with time to look up."""
MAX_MESSAGES = 500


def read_error(error: BaseException) -> str:
    """The text of an error, as a phrase where it was made of one."""
    return error.args[0] if error.args and isinstance(error.args[0], Phrase) else str(error)


def user_message(error: BaseException) -> str:
    """Format an edit's error as a sentence; in programs it follows a colon."""
    return begin_sentence(read_error(error))


class Level(Enum):
    """Importance of a message."""

    INFO = "info"
    ERROR = "error"


@dataclass(frozen=True)
class Message:
    """One line of the log."""

    level: Level
    text: str
    when: float
    """Seconds of the wall clock since 1970."""
    shown_until: float
    """Seconds of the monotonic clock at which the toast disappears."""


class Messages:
    """The log, newest last."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._log: list[Message] = []

    @property
    def log(self) -> tuple[Message, ...]:
        """The last messages, newest last."""
        return tuple(self._log)

    @property
    def toasts(self) -> tuple[Message, ...]:
        """Messages still shown over the window."""
        now = self._clock()
        return tuple(message for message in self._log[-5:] if message.shown_until > now)

    def info(self, text: str) -> None:
        """Report that something was done."""
        self._add(Level.INFO, text)

    def error(self, text: str) -> None:
        """Report that something went wrong, and what to do."""
        self._add(Level.ERROR, text)

    def dismiss(self, message: Message | None = None) -> None:
        """Remove a toast, or all of them."""
        self._log = [replace(m, shown_until=0.0) if message in (None, m) else m for m in self._log]

    def _add(self, level: Level, text: str) -> None:
        seconds = max(TOAST_SECONDS[level.value], READING_SECONDS * len(text))
        self._log.append(Message(level, text, time.time(), self._clock() + seconds))
        del self._log[:-MAX_MESSAGES]
