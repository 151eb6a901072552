"""The USD formats as records."""

from __future__ import annotations

from instdrive_core.formats.scene_format import Fidelity, Format
from instdrive_core.formats.usd.scenes import read_usd
from instdrive_core.formats.usd.writing import order_by_prim, write_usd

_FIDELITY = Fidelity(order_scene=order_by_prim)


def _make_format(title: str, suffix: str) -> Format:
    return Format(title, suffix, read_usd, write_usd, _FIDELITY, up="+z", keeps_tracks=True)


USDA = _make_format("OpenUSD, text (Gaussian splats)", ".usda")
USDC = _make_format("OpenUSD, binary (Gaussian splats)", ".usdc")
USD = _make_format("OpenUSD (Gaussian splats)", ".usd")
USDZ = _make_format("OpenUSD package (Gaussian splats)", ".usdz")
