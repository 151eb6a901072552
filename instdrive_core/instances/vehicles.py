"""Telling vehicles from other things by what they are called."""

from __future__ import annotations

import re

from instdrive_core.instances.table import Instance

WORDS = frozenset(("car", "vehicle", "truck", "bus", "van"))


def is_vehicle(instance: Instance) -> bool:
    """Whether an instance is a vehicle, by its class, or where that is unknown by its name."""
    label = instance.class_name or instance.name
    return not WORDS.isdisjoint(re.split(r"[^a-z]+", label.lower()))
