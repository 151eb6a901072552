"""Charts of how training went: PSNR, losses and size over time, of one run or of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from instdrive_core.evaluation.page.charts import Curve, LineChart, build_line_chart
from instdrive_core.evaluation.training_log import LoggedStep, get_column, get_term, list_terms

_UNIT = "seconds of training"
_TITLES = {"rgb": "colour stage", "instances": "instance stage"}


def build_training_charts(steps: Sequence[LoggedStep]) -> list[LineChart]:
    """Charts of one run's log; none where it reported nothing."""
    charts = [
        build_line_chart("PSNR of training images (dB)", _UNIT, [_build_curve("PSNR", steps, "psnr")]),
        build_line_chart("Gaussians", _UNIT, [_build_curve("Gaussians", steps, "gaussians")]),
    ]
    for stage, part in _group_by_stage(steps).items():
        curves = [_build_curve("loss", part, "loss")]
        curves += [Curve(name, get_column(part, "seconds"), get_term(part, name)) for name in list_terms(part)]
        title = f"Loss and its weighted terms, {_TITLES.get(stage, stage)}"
        charts.append(build_line_chart(title, _UNIT, curves, logarithmic=True))
    return [chart for chart in charts if chart is not None]


def build_compared_charts(logs: Mapping[str, Sequence[LoggedStep]]) -> list[LineChart]:
    """Charts that lay the same curve of several runs over each other; `logs` by name of the run."""

    def overlay(title: str, name: str, stage: str | None = None, logarithmic: bool = False) -> LineChart | None:
        curves = []
        for run, steps in logs.items():
            part = steps if stage is None else [step for step in steps if step.stage == stage]
            curves.append(_build_curve(run, part, name))
        return build_line_chart(title, _UNIT, curves, logarithmic)

    stages = dict.fromkeys(step.stage for steps in logs.values() for step in steps)
    charts = [overlay("PSNR of training images (dB)", "psnr"), overlay("Gaussians", "gaussians")]
    charts += [overlay(f"Loss, {_TITLES.get(stage, stage)}", "loss", stage, logarithmic=True) for stage in stages]
    return [chart for chart in charts if chart is not None]


def _build_curve(name: str, steps: Sequence[LoggedStep], field: str) -> Curve:
    return Curve(name, get_column(steps, "seconds"), get_column(steps, field))


def _group_by_stage(steps: Sequence[LoggedStep]) -> dict[str, list[LoggedStep]]:
    stages: dict[str, list[LoggedStep]] = {}
    for step in steps:
        stages.setdefault(step.stage, []).append(step)
    return stages
