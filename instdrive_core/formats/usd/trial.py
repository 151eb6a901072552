"""What a process of its own does with a USD file: all that reading does."""

from __future__ import annotations

from typing import Any

from instdrive_core.files.trial import run_trial
from instdrive_core.formats.usd.stage import load_usd


def _read_all(path: str) -> None:
    sdf, usd = load_usd("Sdf"), load_usd("Usd")
    layer = sdf.Layer.FindOrOpen(path)

    def look(place: Any) -> None:
        spec = layer.GetObjectAtPath(place)
        for key in spec.ListInfoKeys() if spec else ():
            spec.GetInfo(key)
        for code in layer.ListTimeSamplesForPath(place):
            layer.QueryTimeSample(place, code)

    layer.Traverse("/", look)
    if not layer.GetCompositionAssetDependencies():  # other files are read once it is known where they lie
        stage, first = usd.Stage.Open(layer), usd.TimeCode.EarliestTime()
        for prim in stage.Traverse(usd.TraverseInstanceProxies()):
            for attribute in prim.GetAttributes():
                attribute.Get(first)


if __name__ == "__main__":
    run_trial(_read_all)
