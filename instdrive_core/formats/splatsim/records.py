"""The bundle as a record, and packages of OpenUSD, of which a bundle is one by its ending."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from instdrive_core.formats.allocation import WHOLE, ReadOptions
from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.formats.splatsim.layout import is_bundle
from instdrive_core.formats.splatsim.reading import read_bundle
from instdrive_core.formats.splatsim.writing import order_for_bundle, write_bundle
from instdrive_core.formats.spz.scenes import compute_position_error
from instdrive_core.formats.usd.records import USDZ
from instdrive_core.scene.scene import Scene

SPLATSIM = Format(
    "splatsim scene bundle",
    ".splatsim.usdz",
    read_bundle,
    write_bundle,
    Fidelity(compute_position_error, order_scene=order_for_bundle),
    up="+z",
    keeps_tracks=True,
)


def read_package(path: Path, options: ReadOptions = WHOLE) -> Scene:
    """Open a .usdz: a bundle by its content, else a package of OpenUSD. Raises what either does."""
    return read_bundle(path, options) if is_bundle(path) else USDZ.read(path, options=options)


USDZ_OF_ANY_KIND = replace(USDZ, read=read_package)
