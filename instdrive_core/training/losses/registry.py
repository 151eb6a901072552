"""All loss terms of a training run, in the order in which they are added up.

A new term is a record in `rgb_terms` or `instance_terms`: the trainer computes it, events and log name it, and
`docs/method.md` has a row for it, which a test checks.
"""

from __future__ import annotations

from typing import Any

from instdrive_core.training.losses.instance_terms import INSTANCE_TERMS
from instdrive_core.training.losses.loss_term import LossTerm
from instdrive_core.training.losses.rgb_terms import RGB_TERMS

LOSS_TERMS: tuple[LossTerm[Any], ...] = (*RGB_TERMS, *INSTANCE_TERMS)


def format_loss_table() -> str:
    """The terms as rows of a Markdown table: name, meaning, needs, weight."""
    lines = ["| term | asks that | needs | weight |", "|---|---|---|---|"]
    for term in LOSS_TERMS:
        weight = f"`{term.weight_field}`" if term.weight_field else "1"
        lines.append(f"| `{term.name}` | {term.meaning} | {term.needs} | {weight} |")
    return "\n".join(lines)
