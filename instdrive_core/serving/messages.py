"""Messages of AlpaSim's SensorsimService, made at run time of the compiled `sensorsim.proto`.

They live in a pool of their own: a program that has AlpaSim's generated modules, too, has no two of one name.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any

SERVICE = "nre.grpc.protos.sensorsim.SensorsimService"
_PACKAGE = SERVICE.rpartition(".")[0]


@cache
def _load_pool() -> Any:
    from google.protobuf import descriptor_pb2, descriptor_pool

    pool = descriptor_pool.DescriptorPool()
    described = descriptor_pb2.FileDescriptorSet.FromString(
        files("instdrive_core.serving").joinpath("sensorsim.binpb").read_bytes()
    )
    for file in described.file:
        pool.Add(file)
    return pool


@cache
def find_message_class(name: str) -> Any:
    """Find a message's class, e.g. ``RGBRenderRequest`` or ``AvailableCamerasReturn.AvailableCamera``."""
    from google.protobuf import message_factory

    return message_factory.GetMessageClass(_load_pool().FindMessageTypeByName(f"{_PACKAGE}.{name}"))


@cache
def find_enum_value(enum: str, name: str) -> int:
    """Find the number of an enum's value, e.g. of ``ImageFormat`` ``PNG``."""
    return _load_pool().FindEnumTypeByName(f"{_PACKAGE}.{enum}").values_by_name[name].number


def pack_message(message: Any) -> bytes:
    """Pack a message as it is sent."""
    return message.SerializeToString()


def name_enum_value(enum: str, number: int) -> str:
    """Name an enum's value; the number itself where it has none."""
    value = _load_pool().FindEnumTypeByName(f"{_PACKAGE}.{enum}").values_by_number.get(number)
    return str(number) if value is None else value.name


@cache
def list_methods() -> dict[str, tuple[Any, Any]]:
    """List the service's methods: the classes of request and response, by name."""
    from google.protobuf import message_factory

    methods = _load_pool().FindServiceByName(SERVICE).methods
    make = message_factory.GetMessageClass
    return {method.name: (make(method.input_type), make(method.output_type)) for method in methods}
