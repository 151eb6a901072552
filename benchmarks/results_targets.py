"""What was aimed at, and whether it was reached."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.outcomes import PUBLISHED, SPLIT, Figures, Results, difference, format_value, ratio, table, value

OVER_BASELINE = 0.10
"""Scene mIoU by which our method is to lead the stronger row of each baseline."""


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


def _compare_with_reference(path: str, reference: str) -> Callable[[Figures], float | None]:
    return lambda figures: ratio(value(figures, path), value(figures, reference))


TARGETS = (
    Target("reference's scene mIoU", _figure("scene.reference_miou"), 0.78),
    Target("scene mIoU ÷ reference's", _compare_with_reference("scene.miou", "scene.reference_miou"), 0.93),
    Target("PQ ÷ reference's", _compare_with_reference("scene.pq", "scene.reference_pq"), 0.85),
    Target("LiDAR AP50", _figure("lidar.ap50"), 0.65),
    Target("click hit rate", _figure("click.hit_rate"), 0.92),
    Target("collateral", _figure("click.collateral"), 0.02, at_least=False, digits=4),
    Target("residue", _figure("click.residue"), 0.01, at_least=False, digits=4),
    Target("objects per instance", _figure("lidar.objects_per_instance"), 1.03, at_least=False),
    Target("instances per object", _figure("lidar.instances_per_object"), 1.2, at_least=False),
)


def find_stronger(results: Results, place: tuple[str, str, str], method: str) -> float | None:
    """Scene mIoU of the stronger of a baseline's rows; None where neither is known."""
    both = [value(results.figures(*place, method, "", row), "scene.miou") for row in (PUBLISHED, SPLIT)]
    return max((number for number in both if number is not None), default=None)


def targets_table(results: Results, places: dict[str, tuple[str, str, str]], baselines: dict[str, str]) -> str:
    """Targets against our figures; columns are `places` by title: clip, cameras, masks. `baselines`: title → method."""
    ours = {title: results.figures(*place, "instdrive") for title, place in places.items()}
    rows = [
        [target.text, target.format_bound(), *(target.judge(target.of(figures)) for figures in ours.values())]
        for target in TARGETS
    ]
    for title, method in baselines.items():
        lead = Target(f"scene mIoU above {title}'s stronger row", lambda figures: None, OVER_BASELINE)
        leads = [
            difference(value(own, "scene.miou"), find_stronger(results, place, method))
            for own, place in zip(ours.values(), places.values(), strict=True)
        ]
        rows.append([lead.text, lead.format_bound(), *map(lead.judge, leads)])
    return table(["target", "bound", *places], rows)
