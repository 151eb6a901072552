"""The catalogues of the window's languages, kept up to date with the sources.

`python -m benchmarks.catalogue` writes new texts into every catalogue (``locale/CODE/LC_MESSAGES/instdrive.po``) and
drops those that are gone, compiles the catalogues, and prints one JSON line: how many texts there are, and which have
no translation. Exits 1 where any has none. `--check` writes nothing, and exits 1 where a run would change a catalogue.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import tyro
from babel.messages.catalog import Catalog
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po

from benchmarks.ui_texts import list_ui_texts
from instdrive_app.language.languages import ENGLISH, LANGUAGES
from instdrive_app.language.translation import CATALOGUES, DOMAIN


@dataclass(frozen=True)
class Options:
    """What to do."""

    check: bool = False
    """Write nothing."""


def main(options: Options) -> None:
    """Bring every catalogue up to date and print what it lacks."""
    missing: dict[str, list[str]] = {}
    changed: list[str] = []
    for code in LANGUAGES:
        if code == ENGLISH:
            continue
        catalogue = update_catalogue(code)
        for path, written in render_catalogue(catalogue, code).items():
            if not path.exists() or path.read_bytes() != written:
                changed.append(path.name)
                if not options.check:
                    path.parent.mkdir(parents=True, exist_ok=True)
                    path.write_bytes(written)
        missing[code] = list_missing(catalogue)
    print(json.dumps({"texts": len(list_ui_texts()), "changed": changed, "missing": missing}, ensure_ascii=False))
    if any(missing.values()) or (options.check and changed):
        raise SystemExit(1)


def find_catalogue(code: str, ending: str = ".po") -> Path:
    """Path of a language's catalogue: ``.po`` to be edited, ``.mo`` as gettext reads it."""
    return CATALOGUES / code / "LC_MESSAGES" / f"{DOMAIN}{ending}"


def read_catalogue(code: str) -> Catalog:
    """Read a language's catalogue; an empty one where there is none yet."""
    path = find_catalogue(code)
    if not path.exists():
        return _create_catalogue(code)
    with path.open("rb") as stream:
        return read_po(stream, locale=code, domain=DOMAIN)


def update_catalogue(code: str) -> Catalog:
    """Read a language's catalogue and give it exactly the texts of the sources, in their order."""
    old, new = read_catalogue(code), _create_catalogue(code)
    for found in list_ui_texts():
        key = (found.text, found.plural) if found.plural else found.text
        before = old.get(found.text)
        kept = before.string if before is not None and bool(found.plural) == bool(before.pluralizable) else ""
        file = found.place.partition(":")[0]
        new.add(key, kept or None, locations=[(file, 1)], user_comments=before.user_comments if before else ())
    return new


def render_catalogue(catalogue: Catalog, code: str) -> dict[Path, bytes]:
    """Write a catalogue in both forms, by the paths where they belong."""
    edited, compiled = BytesIO(), BytesIO()
    write_po(edited, catalogue, width=120, include_lineno=False)
    write_mo(compiled, catalogue)
    return {find_catalogue(code): edited.getvalue(), find_catalogue(code, ".mo"): compiled.getvalue()}


def list_missing(catalogue: Catalog) -> list[str]:
    """List the texts without a translation, or with an uncertain one."""
    return [_name_text(message.id) for message in catalogue if message.id and (not _is_said(message) or message.fuzzy)]


def _is_said(message) -> bool:
    said = message.string
    return all(said) if isinstance(said, tuple) else bool(said)


def _name_text(text) -> str:
    return text[0] if isinstance(text, tuple) else text


def _create_catalogue(code: str) -> Catalog:
    """An empty catalogue whose head says nothing that differs from run to run."""
    return _PlainCatalog(locale=code, domain=DOMAIN, header_comment="# Texts of the window.", fuzzy=False)


class _PlainCatalog(Catalog):
    """A catalogue whose head names neither dates nor tools."""

    @property
    def mime_headers(self) -> list[tuple[str, str]]:
        """What gettext needs."""
        return [
            ("Project-Id-Version", "InstDrive"),
            ("Language", str(self.locale)),
            ("Plural-Forms", self.plural_forms),
            ("MIME-Version", "1.0"),
            ("Content-Type", "text/plain; charset=utf-8"),
            ("Content-Transfer-Encoding", "8bit"),
        ]


if __name__ == "__main__":
    main(tyro.cli(Options))
