"""Telling vehicles from other things by what they are called."""

from __future__ import annotations

import re

from instdrive_core.instances.table import Instance

_VEHICLES = frozenset(
    [
        "car",
        "suv",
        "van",
        "minivan",
        "caravan",
        "vehicle",
        "vehicular",
        "truck",
        "pickup",
        "lorry",
        "bus",
        "trailer",
        "towed",
        "tram",
        "trolley",
        "train",
    ]
)
_OPEN = re.compile(r"cycl|bike|scooter|pedicab|rickshaw|wheelchair|rider|rack")
"""Nuscenes and PandaSet call things without a body, such as bicycles, vehicles, too."""


def is_vehicle(instance: Instance) -> bool:
    """Whether an instance is a vehicle, by its class, or where that is unknown by its name."""
    return names_vehicle(instance.class_name or instance.name)


def names_vehicle(label: str) -> bool:
    """Whether any data set's class, such as Pickup Truck or vehicle.bus.rigid, means vehicles with a closed body."""
    label = label.lower()
    return not _VEHICLES.isdisjoint(re.split(r"[^a-z]+", label)) and not _OPEN.search(label)
