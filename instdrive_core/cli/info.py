"""``instdrive info``: what a scene or a driving clip holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tyro
from PIL import Image

from instdrive_core.cli.histogram_picture import draw_histograms
from instdrive_core.datasets.clip import ClipOptions
from instdrive_core.datasets.clip_facts import list_clip_facts
from instdrive_core.datasets.registry import find_data_set
from instdrive_core.errors import OptionError
from instdrive_core.files.atomic import open_atomically
from instdrive_core.project.open import open_edited_scene
from instdrive_core.scene.lint import Defect, find_defects
from instdrive_core.scene.scene import Scene
from instdrive_core.wording import format_count

SHOWN_ROWS = 3
"""Splats named per finding."""


def print_info(
    scene: tyro.conf.Positional[Path],
    *,
    instances: int = 20,
    histogram: Path | None = None,
    keep_every: int = 1,
    first: int | str | None = None,
    last: int | str | None = None,
) -> None:
    """Print what a scene file or a driving clip holds.

    What is odd about a scene's splats is listed too. The exit status is 0 where it opens and 2 where it does not.

    Args:
        scene: Scene file, run folder, or project; of a project, what its edits made of the scene. Or a clip's folder.
        instances: How many instances to list, the largest first.
        histogram: PNG file to write: how opacities, sizes, colours and places of the splats are spread.
        keep_every: 3 opens every 3rd splat only, each made larger: for scenes that do not fit into memory.
        first: First time step of a clip to look at, e.g. 30, or seconds, e.g. 3s.
        last: Last time step or second to look at, e.g. 59 or 8.5s.
    """
    if histogram is not None and histogram.suffix.lower() != ".png":
        raise OptionError(f"--histogram {histogram} does not end in .png, the only format that is written")
    data_set = find_data_set(str(scene))
    if data_set is not None:
        part = ClipOptions(scale=1.0, first_frame=first, last_frame=last)
        _print_facts(list_clip_facts(data_set.title, data_set.load(str(scene), part)))
        return
    if first is not None or last is not None:
        raise OptionError(f"--first and --last choose a part of a driving clip, and {scene} is none; leave them out")
    opened = open_edited_scene(scene, keep_every)
    _print_facts(_list_facts(opened))
    _print_findings(find_defects(opened))
    _print_instances(opened, instances)
    if histogram is not None:
        with open_atomically(histogram) as file:
            Image.fromarray(draw_histograms(opened.gaussians)).save(file, format="PNG")
        print(f"\n{histogram}")


def _print_facts(facts: list[tuple[str, str]]) -> None:
    width = max(14, *(len(label) + 2 for label, _ in facts))
    for label, value in facts:
        print(f"{label + ':':<{width}}{value}")


def _print_findings(findings: tuple[Defect, ...]) -> None:
    print("findings:     none" if not findings else "findings:")
    for finding in findings:
        first = ", ".join(map(str, finding.rows[:SHOWN_ROWS]))
        more = ", …" if len(finding.rows) > SHOWN_ROWS else ""
        print(f"  {finding.what}{f' (rows {first}{more})' if first else ''}. {finding.remedy}")


def _print_instances(opened: Scene, instances: int) -> None:
    largest = sorted(opened.table, key=lambda instance: (-instance.count, instance.id))[: max(instances, 0)]
    width = max([len("class"), *(len(instance.class_name) for instance in largest)])
    if largest:
        print(f"\n{'ID':>8}  {'splats':>9}  {'codeword':>10}  {'class':<{width}}  name")
    for instance in largest:
        counts = f"{instance.id:>8}  {instance.count:>9,}  {instance.codeword:>10}"
        print(f"{counts}  {instance.class_name or '-':<{width}}  {instance.name}")
    if len(opened.table) > len(largest):
        print(f"… and {len(opened.table) - len(largest)} more (--instances {len(opened.table)})")


def _list_facts(scene: Scene) -> list[tuple[str, str]]:
    gaussians = scene.gaussians
    facts = [
        ("splats", f"{len(scene):,}"),
        ("colour", f"SH degree {gaussians.sh_degree}"),
        ("features", f"{gaussians.features.shape[1]} per splat, {scene.code_bits} code bits"),
    ]
    if scene.antialiased:
        facts.append(("drawn", "antialiased: small splats fade instead of growing"))
    finite = np.isfinite(gaussians.means).all(axis=1)
    if finite.any():
        low, high = np.quantile(gaussians.means[finite], [0.01, 0.99], axis=0)
        sizes = np.exp(np.quantile(gaussians.log_scales[finite].max(axis=1), [0.05, 0.5, 0.95]).clip(-80, 80))
        opaque = np.quantile(gaussians.opacities[finite], [0.05, 0.5, 0.95])
        facts += [
            ("extent", f"{_format_numbers(low)} to {_format_numbers(high)} m (98 % of the splats)"),
            ("size", f"{_format_numbers(sizes)} m (longest axis; 5, 50, 95 %)"),
            ("opacity", f"{_format_numbers(opaque)} (5, 50, 95 %)"),
        ]
    labelled = int(np.count_nonzero(scene.instance_ids))
    facts.append(("instances", f"{len(scene.table)}, on {labelled:,} splats"))
    if scene.origin.any():
        facts.append(("origin", f"{_format_numbers(scene.origin)} m"))
    if scene.actors:
        moving = np.count_nonzero(scene.nodes)
        facts.append(("actors", f"{len(scene.actors)} moving objects of {moving:,} splats"))
    if scene.seen_movers:
        cameras = ", ".join(sorted({mover.camera for mover in scene.seen_movers}))
        facts.append(("seen moving", f"{format_count(len(scene.seen_movers), 'thing')}, not rebuilt ({cameras})"))
    if scene.views:
        cameras = ", ".join(sorted({view.name for view in scene.views}))
        times = [view.time for view in scene.views]
        facts.append(("views", f"{len(scene.views)} photos from {min(times):g} to {max(times):g} s ({cameras})"))
    facts.append(("sky", f"cube map of {scene.sky.faces.shape[1]} px faces" if scene.sky is not None else "none"))
    if scene.extra:
        facts.append(("more columns", ", ".join(scene.extra)))
    facts += [("left out", sentence) for sentence in scene.left_out]
    return facts


def _format_numbers(values: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.3g}" for value in values) + ")"
