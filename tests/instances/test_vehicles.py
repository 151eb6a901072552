"""Vehicles are known by the words of every data set."""

import pytest

from instdrive_core.instances.table import Instance
from instdrive_core.instances.vehicles import is_vehicle, names_vehicle


@pytest.mark.parametrize(
    ("class_name", "name", "expected"),
    [
        ("Car", "", True),
        ("Semi-truck", "", True),
        ("Other Vehicle - Uncommon", "", True),
        ("Carpet", "", False),
        ("", "red van", True),
        ("Tree", "car tree", False),
    ],
)
def test_vehicles_are_known_by_class_or_name(class_name, name, expected):
    assert is_vehicle(Instance(1, name, class_name=class_name)) is expected


CLOSED = (
    "Car, Pickup Truck, Medium-sized Truck, Semi-truck, Towed Object, Other Vehicle - Construction Vehicle, "
    "Emergency Vehicle, Bus, Train, Trolley, Tram / Subway, vehicle.car, vehicle.bus.rigid, vehicle.trailer, "
    "TYPE_VEHICLE, REGULAR_VEHICLE, BOX_TRUCK, ARTICULATED_BUS, VEHICULAR_TRAILER, RAILED_VEHICLE, Van, caravan"
)
OPEN = (
    "Motorcycle, Bicycle, Other Vehicle - Pedicab, Motorized Scooter, Personal Mobility Device, Pedestrian, "
    "vehicle.bicycle, vehicle.motorcycle, human.pedestrian.wheelchair, static_object.bicycle_rack, MOTORCYCLIST, "
    "WHEELED_RIDER, TYPE_CYCLIST, Person_sitting, Animals - Bird, Signs, CONSTRUCTION_CONE, Road"
)


@pytest.mark.parametrize("label", CLOSED.split(", "))
def test_closed_bodies_are_vehicles_in_every_data_set(label):
    assert names_vehicle(label)


@pytest.mark.parametrize("label", OPEN.split(", "))
def test_what_has_no_body_is_no_vehicle(label):
    assert not names_vehicle(label)
