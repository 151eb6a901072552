"""What was aimed at, and whether it was reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.outcomes import Figures, Results, difference, format_value, ratio, table, value

OVER_BASELINE = 0.10
"""Scene mIoU by which our method is to lead each baseline's split row."""


@dataclass(frozen=True)
class Target:
    """A bound for one figure."""

    text: str
    of: Callable[[Figures], float | None]
    bound: float
    at_least: bool = True
    digits: int = 3

    def judge(self, number: float | None) -> str:
        """The number, in bold where it misses the bound."""
        if number is None:
            return "–"
        met = number >= self.bound if self.at_least else number <= self.bound
        return format_value(number, self.digits) if met else f"**{format_value(number, self.digits)} missed**"

    def format_bound(self) -> str:
        """The bound for readers."""
        return f"{'≥' if self.at_least else '≤'} {self.bound:g}"


def _figure(path: str) -> Callable[[Figures], float | None]:
    return lambda figures: value(figures, path)


def _compare_with_oracle(path: str, oracle: str) -> Callable[[Figures], float | None]:
    return lambda figures: ratio(value(figures, path), value(figures, oracle))


TARGETS = (
    Target("oracle scene mIoU", _figure("scene.oracle_miou"), 0.78),
    Target("scene mIoU ÷ oracle's", _compare_with_oracle("scene.miou", "scene.oracle_miou"), 0.93),
    Target("PQ ÷ oracle's", _compare_with_oracle("scene.pq", "scene.oracle_pq"), 0.85),
    Target("LiDAR AP50", _figure("lidar.ap50"), 0.65),
    Target("click hit rate", _figure("click.hit_rate"), 0.92),
    Target("collateral", _figure("click.collateral"), 0.02, at_least=False, digits=4),
    Target("residue", _figure("click.residue"), 0.01, at_least=False, digits=4),
    Target("objects per instance", _figure("lidar.objects_per_instance"), 1.03, at_least=False),
    Target("instances per object", _figure("lidar.instances_per_object"), 1.2, at_least=False),
)


def targets_table(results: Results, places: dict[str, tuple[str, str, str]], baselines: dict[str, str]) -> str:
    """Targets against our figures; columns are `places` by title: clip, cameras, masks. `baselines`: title → method."""
    ours = {title: results.figures(*place, "instdrive") for title, place in places.items()}
    rows = [
        [target.text, target.format_bound(), *(target.judge(target.of(figures)) for figures in ours.values())]
        for target in TARGETS
    ]
    for title, method in baselines.items():
        lead = Target(f"scene mIoU above {title}, split", lambda figures: None, OVER_BASELINE)
        theirs = [results.figures(*place, method) for place in places.values()]
        leads = [
            difference(value(own, "scene.miou"), value(other, "scene.miou"))
            for own, other in zip(ours.values(), theirs, strict=True)
        ]
        rows.append([lead.text, lead.format_bound(), *map(lead.judge, leads)])
    return table(["target", "bound", *places], rows)
