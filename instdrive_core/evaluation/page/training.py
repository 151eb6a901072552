"""How training went: PSNR, losses and size over time, of one run or of several."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from instdrive_core.evaluation.page.charts import Curve, line_chart
from instdrive_core.evaluation.page.elements import Markup, element
from instdrive_core.evaluation.training_log import LoggedStep, get_column, get_term, list_terms

_UNIT = "seconds of training"
_TITLES = {"rgb": "colour stage", "instances": "instance stage"}


def training_charts(steps: Sequence[LoggedStep]) -> Markup | None:
    """Charts of one run's log; None where it reported nothing."""
    charts = [
        line_chart("PSNR of training images (dB)", _UNIT, [_curve("PSNR", steps, "psnr")]),
        line_chart("Gaussians", _UNIT, [_curve("Gaussians", steps, "gaussians")]),
    ]
    for stage, part in _by_stage(steps).items():
        curves = [_curve("loss", part, "loss")]
        curves += [Curve(name, get_column(part, "seconds"), get_term(part, name)) for name in list_terms(part)]
        title = f"Loss and its weighted terms, {_TITLES.get(stage, stage)}"
        charts.append(line_chart(title, _UNIT, curves, logarithmic=True))
    return _charts(charts)


def compared_charts(logs: Mapping[str, Sequence[LoggedStep]]) -> Markup | None:
    """The same curve of several runs in one chart each; `logs` by name of the run."""

    def overlaid(title: str, name: str, stage: str | None = None, logarithmic: bool = False) -> Markup | None:
        curves = []
        for run, steps in logs.items():
            part = steps if stage is None else [step for step in steps if step.stage == stage]
            curves.append(_curve(run, part, name))
        return line_chart(title, _UNIT, curves, logarithmic)

    stages = dict.fromkeys(step.stage for steps in logs.values() for step in steps)
    charts = [overlaid("PSNR of training images (dB)", "psnr"), overlaid("Gaussians", "gaussians")]
    charts += [overlaid(f"Loss, {_TITLES.get(stage, stage)}", "loss", stage, logarithmic=True) for stage in stages]
    return _charts(charts)


def _charts(charts: Sequence[Markup | None]) -> Markup | None:
    drawn = [chart for chart in charts if chart is not None]
    return element("div", *drawn, class_="charts") if drawn else None


def _curve(name: str, steps: Sequence[LoggedStep], field: str) -> Curve:
    return Curve(name, get_column(steps, "seconds"), get_column(steps, field))


def _by_stage(steps: Sequence[LoggedStep]) -> dict[str, list[LoggedStep]]:
    stages: dict[str, list[LoggedStep]] = {}
    for step in steps:
        stages.setdefault(step.stage, []).append(step)
    return stages
