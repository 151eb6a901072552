"""Finding titles by a few typed letters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

Item = TypeVar("Item")

_WORD_START, _IN_ROW, _ANYWHERE = 8, 5, 1
"""Points for a letter at the start of a word, right after the last one, or elsewhere."""


def score_match(typed: str, title: str) -> int | None:
    """Score how well `title` matches `typed`, whose letters must occur in that order; None where they do not.

    Letters at the start of words and letters in a row count more, so that ``exp`` finds ``Export`` before ``Explode at
    page``, and ``sc`` finds ``Split by component`` at all.
    """
    text, wanted = title.lower(), "".join(typed.lower().split())
    # best[j]: the best score of the letters so far with the last one found at j.
    best: dict[int, int] = {-1: 0}
    for letter in wanted:
        following: dict[int, int] = {}
        for place, found in enumerate(text):
            if found != letter:
                continue
            before = [(score, last) for last, score in best.items() if last < place]
            if before:
                worth = _WORD_START if place == 0 or not text[place - 1].isalnum() else _ANYWHERE
                following[place] = max(
                    score + (max(worth, _IN_ROW) if last == place - 1 and last >= 0 else worth)
                    for score, last in before
                )
        best = following
        if not best:
            return None
    return max(best.values())


def find_best_matches(typed: str, items: Iterable[Item], title: Callable[[Item], str]) -> list[Item]:
    """Find the items that match `typed`, best first; all in their order where nothing is typed."""
    scored = [(score_match(typed, title(item)), item) for item in items]
    found = [(score, item) for score, item in scored if score is not None]
    return [item for _, item in sorted(found, key=lambda pair: -pair[0])]
