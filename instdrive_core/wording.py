"""Texts for the user: numbers with their nouns, and sentences that can be said again in another language."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any


class Phrase(str):
    """A text in English that knows the template and values it was made of.

    It is an ordinary string wherever texts are stored, compared or printed. Where a window shows it, the template is
    looked up in the catalogue of the user's language and filled in anew.
    """

    template: str
    """The text with named placeholders, e.g. ``Saved {path}``."""
    plural: str
    """The template for other counts than 1; empty where nothing is counted."""
    values: Mapping[str, Any]
    """What stands for the placeholders. Values that are phrases themselves are translated as well."""
    finish: Callable[[str], str]
    """Changes the filled-in text of any language at last, e.g. its first letter to a capital."""


def phrase(template: str, /, **values: Any) -> Phrase:
    """Fill in the named placeholders of a template, e.g. ``phrase("Saved {path}", path=path)``; a phrase stays itself.

    Raises KeyError for a placeholder without a value.
    """
    if isinstance(template, Phrase) and not values:
        return template
    return _make_phrase(template.format(**values) if values else template, template, "", values)


def count_phrase(count: int, one: str, many: str, /, **values: Any) -> Phrase:
    """Fill in `one` or `many`, as the count asks for; ``{count}`` stands for the count in both."""
    values = {"count": count, **values}
    return _make_phrase((one if count == 1 else many).format(**values), one, many, values)


def format_count(count: int, noun: str, plural: str = "") -> Phrase:
    """Write a count with its noun: ``1 splat``, ``2,000 splats``. Give `plural` where it is not the noun with an s."""
    return count_phrase(count, f"{{count:,}} {noun}", f"{{count:,}} {plural or noun + 's'}")


def begin_sentence(text: str) -> Phrase:
    """Write the first letter of a text as a capital."""
    return _finish_phrase(text, _raise_first_letter)


def chain_sentences(*sentences: str) -> Phrase:
    """Write sentences one after the other, without the empty ones."""
    parts = {f"part{number}": phrase(text) for number, text in enumerate(filter(None, sentences))}
    return phrase(" ".join(f"{{{name}}}" for name in parts), **parts)


def list_phrases(names: Sequence[str]) -> Phrase:
    """Write names with commas between them."""
    parts = {f"part{number}": name for number, name in enumerate(names)}
    return phrase(", ".join(f"{{{name}}}" for name in parts), **parts)


def drop_ellipsis(text: str) -> Phrase:
    """Leave out the dots at the end, by which the name of a command announces a question."""
    return _finish_phrase(text, _strip_dots)


def _raise_first_letter(text: str) -> str:
    return text[:1].upper() + text[1:]


def _strip_dots(text: str) -> str:
    return text.rstrip("… ")


def _finish_phrase(text: str, finish: Callable[[str], str]) -> Phrase:
    source = text if isinstance(text, Phrase) else phrase(text)
    return _make_phrase(finish(text), source.template, source.plural, source.values, finish)


def _make_phrase(
    text: str, template: str, plural: str, values: Mapping[str, Any], finish: Callable[[str], str] = str
) -> Phrase:
    made = Phrase(text)
    made.template, made.plural, made.values, made.finish = template, plural, values, finish
    return made
