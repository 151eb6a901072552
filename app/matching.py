"""Finding titles by a few typed letters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

Item = TypeVar("Item")

_SHORTEST_WORD = 3
"""Letters from which on other words count."""
_IN_ROW, _WORD_START, _ANYWHERE = 9, 8, 1
"""Points for a letter right after the last one, at the start of a word, or elsewhere."""


def score_match(typed: str, title: str) -> int | None:
    """Score how well `title` matches `typed`, whose letters must occur in that order; None where they do not.

    Letters at the start of words and letters in a row count more, so that ``sc`` finds ``Split by component`` before
    ``Rescue``. A row counts most.
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
                    score + (_IN_ROW if last == place - 1 and last >= 0 else worth) for score, last in before
                )
        best = following
        if not best:
            return None
    return max(best.values())


def find_best_matches(
    typed: str,
    items: Iterable[Item],
    title: Callable[[Item], str],
    group: Callable[[Item], str] = lambda _: "",
    words: Callable[[Item], tuple[str, ...]] = lambda _: (),
) -> list[Item]:
    """Find the items that match `typed` by title, by group and title, or by the start of one of their other `words`.

    Of two equal matches the one within a title comes first, so that ``delet`` finds ``Delete`` of the menu ``Edit``
    before all else in a menu ``Deletion``. All in their order where nothing is typed.
    """
    found = []
    for item in items:
        within, across = score_match(typed, title(item)), score_match(typed, f"{group(item)} {title(item)}")
        is_named = len(typed.strip()) >= _SHORTEST_WORD and any(
            word.startswith(typed.strip().lower()) for word in words(item)
        )
        scores = [within + 1] if within is not None else []
        scores += [across] if across is not None else []
        scores += [_IN_ROW * len(typed.strip()) - 2] if is_named else []
        if scores:
            found.append((max(scores), item))
    return [item for _, item in sorted(found, key=lambda pair: -pair[0])] if typed else [item for _, item in found]
