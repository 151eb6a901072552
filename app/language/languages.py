"""Languages that the window speaks, and which one to begin with."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass

SYSTEM = "system"
"""The choice to follow the desktop."""
ENGLISH = "en"
"""The language of the texts in the sources, and of the command line."""


@dataclass(frozen=True)
class Language:
    """One language of the window."""

    title: str
    """Its name in itself."""
    grouping: str
    """What stands between the thousands of a number. The decimal point stays one, as in the fields for typing."""


LANGUAGES = {
    ENGLISH: Language("English", ","),
    "de": Language("Deutsch", "\N{NARROW NO-BREAK SPACE}"),
}
"""By codes of ISO 639. Each but English has a catalogue ``locale/CODE/LC_MESSAGES/instdrive.mo``."""
CHOICES = (SYSTEM, *LANGUAGES)
_VARIABLES = ("LANGUAGE", "LC_ALL", "LC_MESSAGES", "LANG")
"""In the order in which gettext asks for them."""


def find_system_language(environment: Mapping[str, str] = os.environ) -> str:
    """Code of the first language among those that the desktop names that the window speaks; else English.

    ``LC_ALL=de_AT.UTF-8`` means German. Only the first variable that is set counts, as for gettext.
    """
    named = next((environment[name] for name in _VARIABLES if environment.get(name)), "")
    codes = (word.split(".")[0].split("_")[0].lower() for word in named.split(":"))
    return next((code for code in codes if code in LANGUAGES), ENGLISH)


def resolve_language(choice: str) -> str:
    """Code of the language that a choice of `CHOICES` means now."""
    return find_system_language() if choice == SYSTEM else choice
