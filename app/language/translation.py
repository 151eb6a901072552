"""Texts in the language of the window, found by gettext in the catalogue."""

from __future__ import annotations

import gettext
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any

from instdrive_app.language.languages import ENGLISH, LANGUAGES
from instdrive_core.wording import Phrase, phrase

DOMAIN = "instdrive"
"""File name of the catalogues."""
CATALOGUES = Path(__file__).parent / "locale"


class _Speaker(Formatter):
    """Fills in templates of one language."""

    def __init__(self, code: str) -> None:
        self.code = code
        self._grouping = LANGUAGES[code].grouping
        self.catalogue: gettext.NullTranslations = gettext.NullTranslations()
        if code != ENGLISH:
            self.catalogue = gettext.translation(DOMAIN, CATALOGUES, [code])

    def say(self, text: str) -> str:
        """Translate a text; one without an entry stays as it is."""
        if not isinstance(text, Phrase):
            return self.catalogue.gettext(text) if text else ""
        if text.plural:
            template = self.catalogue.ngettext(text.template, text.plural, text.values["count"])
        else:
            template = self.catalogue.gettext(text.template) if text.template else ""
        return text.finish(self.vformat(template, (), text.values) if text.values else template)

    def format_field(self, value: Any, format_spec: str) -> str:
        """Write a value; phrases are translated, thousands grouped as in this language."""
        if isinstance(value, Phrase):
            return format(self.say(value), format_spec)
        written = format(value, format_spec)
        return written.replace(",", self._grouping) if "," in format_spec else written


_speaking: list[_Speaker] = [_Speaker(ENGLISH)]
"""One entry: who speaks now."""


@cache
def _load_speaker(code: str) -> _Speaker:
    return _Speaker(code)


def speak(code: str) -> None:
    """Have `translate` answer in another language from now on.

    Raises KeyError for a code that is not in `LANGUAGES`, and FileNotFoundError where its catalogue is missing.
    """
    _speaking[0] = _load_speaker(code)


def get_language() -> str:
    """Code of the language in which `translate` answers."""
    return _speaking[0].code


def translate(text: str, /, **values: Any) -> str:
    """Say a text in the language of the window, e.g. ``translate("Saved {path}", path=path)``.

    A text without an entry in the catalogue stays English.
    """
    return _speaking[0].say(phrase(text, **values) if values else text)


def make_label(text: str, key: str = "", /, **values: Any) -> str:
    """Write a label for ImGui: the text in the language of the window, and an ID that is the same in all of them.

    The ID is `key`, or else the template.
    """
    name = key or (text.template if isinstance(text, Phrase) else text)
    return f"{translate(text, **values)}###{name}"
