"""docs/results.md from the outcomes of cells."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.cells import (
    CAMERA_SETS,
    FULL_LENGTH,
    HEADLINE_SEEDS,
    LOSSES,
    PANDASET,
    PRINTED_ITERATIONS,
    PUBLISHED_TOO,
    SCALED,
    STREET,
    TUNED_ON,
    TUNED_STREET_SEED,
)
from benchmarks.outcomes import (
    PUBLISHED,
    SPLIT,
    Figures,
    Results,
    difference,
    format_spread,
    format_value,
    table,
    value,
)
from benchmarks.results_targets import find_stronger, targets_table

NOTES_START, NOTES_END = "<!-- notes by hand: kept when this page is made again -->", "<!-- end of notes -->"

METHODS: tuple[tuple[str, str, str], ...] = (
    ("Gaussian Grouping", "gaussian-grouping", ""),
    ("OpenGaussian", "opengaussian", ""),
    ("mask graph alone", "mask-graph", ""),
    ("InstDrive, printed forms", "paper", ""),
    ("InstDrive, rate scaled", "paper", SCALED),
    ("InstDrive, own length", "paper", FULL_LENGTH),
    ("**ours**", "instdrive", ""),
)
"""Title, method, variant."""
Place = tuple[str, str, str]
"""Clip, cameras, masks."""
BASELINES = {"Gaussian Grouping": "gaussian-grouping", "OpenGaussian": "opengaussian", "mask graph": "mask-graph"}
MAP_KEYS = {"view mIoU": "per_view.miou", "view mAcc": "per_view.macc", "mIoU": "scene.miou", "mAcc": "scene.macc"}
LIDAR_TITLES = {
    "ap": "AP",
    "ap50": "AP50",
    "ap25": "AP25",
    "miou": "point mIoU",
    "vmeasure": "V-measure",
    "instances_per_object": "inst./object",
    "objects_per_instance": "obj./instance",
    "codes_per_object": "codes/object",
}
CLICK_TITLES = {
    "hit_rate": "click hit rate",
    "iou": "click IoU",
    "collateral": "collateral",
    "residue": "residue",
}
BETTER_HIGH_3D = ("lidar.ap", "lidar.ap50", "lidar.ap25", "lidar.miou", "lidar.vmeasure")
BETTER_LOW_3D = ("lidar.instances_per_object", "lidar.objects_per_instance")
_NOISE = 0.002
"""3D figures that differ by less count as equal."""

_INTRODUCTION = """# Results

Made by `python -m benchmarks.tables` from {done} of {all} cells{scale}; the protocol is in
[evaluation.md](evaluation.md), the baselines are in [baselines.md](baselines.md). A dash is a cell that has not been
run or a figure that does not apply. Code: {commits}. Threads: {threads}. Machine: {machines}. Dates: {dates}.

- **Same substrate.** One geometry per clip and camera set (`--preset quick`, seed 0); every method learns on its frozen
  Gaussians from the same masks. Held out: time steps that end in 4, all cameras.
- **Clips.** Synthetic streets of seeds {seeds}, masks `exact` with faults `sam-v1` (seed 0). Settings were chosen on
  seeds {tuned}, which stay out of the headline, and not on {untouched}, but for what hulls take in, which was chosen
  on all of them ([method](method.md#what-each-step-is-worth)). PandaSet 002 at a quarter of its photos' width.
- **Rows.** A baseline *as published* has one instance per code over the whole scene; *split* adds what ours has, too: a
  node per moving object, and spatial components. The stronger of the two leads, and claims must hold against it.
  Every method sees as many pixels of a photo. *Own length*: the paper's {steps:,} steps, on the frozen geometry.
- **Things** are the headline on PandaSet. Its stuff has no instances: one *building* stands for both sides of a street.
  There, an object of stuff is a connected region of the label map, joined over photos by LiDAR points.
- **Reference**: true IDs on the same Gaussians, from as many pixels of a photo as our votes look at. It is no bound:
  ours leaves less residue.
- **Maps.** What a click selects (`instance` map). *View*: matched inside each view; *scene*: one match for all views
  and cameras.
"""


def page(results: Results, notes: str = "") -> str:
    """The whole page; `notes` are those that someone wrote into it."""
    sections = [
        _introduction(results),
        _headline(results),
        _cameras(results),
        _read_recorded(results),
        _ablations(results),
        _lidar_and_selection(results),
        _cost(results),
        _figures(results),
        f"## Notes\n\n{NOTES_START}\n{notes}\n{NOTES_END}",
    ]
    return "\n\n".join(section.strip() for section in sections if section) + "\n"


def _introduction(results: Results) -> str:
    def all_of(key: str) -> str:
        return ", ".join(sorted({str(outcome[key]) for outcome in results.outcomes.values() if key in outcome})) or "–"

    scale = "" if results.scale == "full" else f" **at {results.scale} scale: the figures mean nothing**"
    return _INTRODUCTION.format(
        done=len(results.outcomes),
        all=sum(not cell.optional or cell.name in results.outcomes for cell in results.cells),
        scale=scale,
        commits=all_of("commit"),
        threads=all_of("threads"),
        machines=all_of("machine"),
        dates=all_of("date"),
        steps=PRINTED_ITERATIONS,
        seeds=_list_names((TUNED_STREET_SEED, *HEADLINE_SEEDS)),
        tuned=_list_names(TUNED_ON),
        untouched=_list_names(HEADLINE_SEEDS),
    )


def list_method_rows(results: Results, places: Sequence[Place]) -> list[tuple[str, str, str, str]]:
    """Title, method, variant and row of every line of a table over some places.

    Of a baseline's two rows the stronger, by mean scene mIoU, leads. Methods that are optional have rows where there
    are figures of them.
    """
    lines = []
    for title, method, variant in METHODS:
        if method not in PUBLISHED_TOO:
            lines.append((title, method, variant, SPLIT))
            continue
        strength = {}
        for row in (PUBLISHED, SPLIT):
            figures = [value(results.figures(*place, method, variant, row), "scene.miou") for place in places]
            known = [number for number in figures if number is not None]
            strength[row] = sum(known) / len(known) if known else 0.0
        if variant == FULL_LENGTH and not any(strength.values()):
            continue
        rows = sorted((PUBLISHED, SPLIT), key=lambda row: -strength[row])
        lines += [(f"{title}, {row}" if row == SPLIT else title, method, variant, row) for row in rows]
    return lines


def _headline(results: Results) -> str:
    untouched = {f"seed {seed}": (f"street-{seed}", "6", "sam-v1") for seed in HEADLINE_SEEDS}
    tuned = {f"seed {TUNED_STREET_SEED}": (STREET, "6", "sam-v1")}
    return (
        f"## Headline: {len(untouched)} streets that settings were not chosen on, hulls apart\n\n"
        f"Mean ± standard deviation over streets.\n\n{_streets_table(results, untouched)}\n\n"
        f"Targets, ours:\n\n{targets_table(results, untouched, BASELINES)}\n\n"
        f"## The street that settings were chosen on\n\n{_streets_table(results, tuned)}\n\n"
        f"{targets_table(results, tuned, BASELINES)}"
    )


def _streets_table(results: Results, streets: dict[str, Place]) -> str:
    keys = {"scene mIoU": "scene.miou", "PQ": "scene.pq"}
    keys |= {"LiDAR AP50": "lidar.ap50", "click hit rate": "click.hit_rate"}
    rows = []
    for title, method, variant, row in list_method_rows(results, list(streets.values())):
        of_streets = [results.figures(*street, method, variant, row) for street in streets.values()]
        single = [format_value(value(figures, "scene.miou")) for figures in of_streets]
        means = [format_spread([value(figures, key) for figures in of_streets]) for key in keys.values()]
        rows.append([title, *means, *single])
    ours = [results.figures(*street, "instdrive") for street in streets.values()]
    means = [format_spread([value(figures, reference_key(key)) for figures in ours]) for key in keys.values()]
    single = [format_value(value(figures, "scene.reference_miou")) for figures in ours]
    rows.append(["*reference: true IDs*", *means, *single])
    return table(["six cameras, `sam-v1`", *keys, *(f"mIoU, {title}" for title in streets)], rows)


def _cameras(results: Results) -> str:
    head = ["scene"] + [f"{count} cam. {title}" for count in CAMERA_SETS for title in MAP_KEYS]
    places = [(STREET, count, "sam-v1") for count in CAMERA_SETS]
    rows = [
        [title, *(cell for place in places for cell in _maps(results.figures(*place, method, variant, row)))]
        for title, method, variant, row in list_method_rows(results, places)
    ]
    rows += _control_rows(results, places)
    reference = [value(results.figures(*place, "instdrive"), "scene.reference_miou") for place in places]
    rows.append(["*reference*", *(cell for number in reference for cell in ("–", "–", format_value(number), "–"))])
    head[0] = f"street, seed {TUNED_STREET_SEED}"
    reference = table(
        ["paper's own, other data", *(f"{count} cam. {name}" for count in ("1", "6") for name in ("mIoU", "mAcc"))],
        [
            ["Gaussian Grouping", "0.7694", "0.8606", "–", "–"],
            ["OpenGaussian", "–", "–", "0.5665", "0.7274"],
            ["InstDrive", "–", "–", "0.7091", "0.8577"],
        ],
    )
    return (
        f"## Table 1: cameras and methods\n\n{table(head, rows)}\n\n"
        "*For reference only*: what the paper reports on its own recordings, with its own masks and 30,000 iterations. "
        f"Other data, so nothing follows from a difference to the rows above.\n\n{reference}"
    )


def _maps(figures: Figures) -> list[str]:
    return [format_value(value(figures, key)) for key in MAP_KEYS.values()]


def _control_rows(results: Results, places: Sequence[tuple[str, str, str]]) -> list[list[str]]:
    controls = [results.outcomes.get("/".join([*place, "instdrive"]), {}).get("controls", {}) for place in places]
    names = dict.fromkeys(name for each in controls for name in each)
    return [[f"*{name}*", *(cell for each in controls for cell in _maps(each.get(name, {})))] for name in names]


def _list_bound_rows(results: Results, place: Place, keys: dict[str, str]) -> list[list[str]]:
    """What every method stands between: the controls that learn nothing, and the reference."""
    controls = results.outcomes.get("/".join([*place, "instdrive"]), {}).get("controls", {})
    ours = results.figures(*place, "instdrive")
    return [
        *([f"*{title}*", *(format_value(value(each, k)) for k in keys.values())] for title, each in controls.items()),
        ["*reference*", *(format_value(value(ours, reference_key(key))) for key in keys.values())],
    ]


def _read_recorded(results: Results) -> str:
    keys = (
        {"things": "scene.miou_things"}
        | MAP_KEYS
        | {"PQ": "scene.pq", "AP50": "lidar.ap50", "point mIoU": "lidar.miou", "hit rate": "click.hit_rate"}
    )
    keys |= {"PSNR": "psnr"}
    parts = []
    for masks, methods in (("lidar", ("instdrive", "opengaussian")), ("annotations", None)):
        place = (PANDASET, "6", masks)
        chosen = [row for row in list_method_rows(results, [place]) if methods is None or row[1] in methods]
        rows = []
        for title, method, variant, kind in chosen:
            figures = results.figures(*place, method, variant, kind)
            digits = [2 if key == "psnr" else 3 for key in keys.values()]
            rows.append(
                [title, *(format_value(value(figures, k), d) for k, d in zip(keys.values(), digits, strict=True))]
            )
        rows += _list_bound_rows(results, place, keys)
        ours = results.figures(*place, "instdrive")
        privileged = "*privileged*: ground truth comes from the same annotations"
        note = f" ({privileged if masks == 'annotations' else 'no labels; moving objects come from cuboids'})"
        parts.append(f"Masks `{masks}`{note}:\n\n{table(['PandaSet 002, 6 cameras', *keys], rows)}")
        lead = difference(value(ours, "scene.miou"), find_stronger(results, place, "opengaussian"))
        parts.append(f"Scene mIoU above OpenGaussian's stronger row: {format_value(lead)} (target ≥ 0.10).")
    return "## PandaSet 002\n\n" + "\n\n".join(parts)


def _ablations(results: Results) -> str:
    keys = {"view mIoU": "per_view.miou", "codeword view mIoU": "codeword.per_view.miou"}
    keys |= {"scene mIoU": "scene.miou", "PQ": "scene.pq"} | {v: f"lidar.{k}" for k, v in LIDAR_TITLES.items()}
    keys |= {"shared codes": "shared_codes", "instances": "n_instances"}
    parts = ["## Ablations", _SCHEDULE.format(seed=TUNED_STREET_SEED, steps=PRINTED_ITERATIONS)]
    for title, method, base, default in (
        ("InstDrive, rate scaled", "paper", SCALED, "d8"),
        ("our losses", "instdrive", LOSSES, ""),
    ):
        variants = {title: base}
        for name, change in _CHANGES.items():
            if change != default:
                variants[name] = f"{base}+{change}"
        place = (STREET, "6", "sam-v1")
        measured = {name: results.figures(*place, method, variant) for name, variant in variants.items()}
        rows = [[name, *(format_value(value(f, key)) for key in keys.values())] for name, f in measured.items()]
        parts.append(table([f"`--method {method}`", *keys], rows))
        parts.append(voxel_sentence(measured[title], measured["without voxel"]))
        parts.append(compare_voxel_sign(measured[title], measured["without voxel"]))
    parts.append(
        "*For reference only*, the paper's 2D mIoU on its own data: 0.7091; without voxel 0.7117, without pseudo "
        "0.6724; d = 6 / 8 / 10: 0.6826 / 0.7091 / 0.7192."
    )
    return "\n\n".join(parts)


_SCHEDULE = """Street of seed {seed}, six cameras, `sam-v1`, on the frozen geometry. The paper's {steps:,} steps become
those of the `quick` preset: what begins at a step keeps its share of the run (pseudo supervision after a third), what
happens every fifth step still does, and the feature rate grows by the factor by which the schedule shrinks, since
Adam's way is rate × steps (*rate scaled*; *printed forms* keeps 2.5e-3, the rate of 3DGS for colours, as the paper
tells none; d = 8). *Our losses* are those of
`--method instdrive` with features that are trained (d = 16), as its default, which votes, has no voxel or pseudo loss.
Components as in every *split* row; `codeword` is the paper's own map."""
_CHANGES = {
    "without voxel": "no-voxel",
    "without pseudo": "no-pseudo",
    "d = 6": "d6",
    "d = 8": "d8",
    "d = 10": "d10",
}


def voxel_sentence(full: Figures, without: Figures) -> str:
    """Which 3D figures get worse without the voxel loss, in words."""
    changes = {
        LIDAR_TITLES[key.removeprefix("lidar.")]: (difference(value(without, key), value(full, key)), sign)
        for keys, sign in ((BETTER_HIGH_3D, -1), (BETTER_LOW_3D, 1))
        for key in keys
    }
    known = {title: (change, sign) for title, (change, sign) in changes.items() if change is not None}
    if not known:
        return "Voxel loss and 3D figures: –"
    worse = [f"{title} {change:+.3f}" for title, (change, sign) in known.items() if sign * change > _NOISE]
    better = [f"{title} {change:+.3f}" for title, (change, sign) in known.items() if sign * change < -_NOISE]
    text = f"Without the voxel loss these 3D figures get worse: {', '.join(worse) or 'none'}"
    return f"{text}; better: {', '.join(better) or 'none'}."


def compare_voxel_sign(full: Figures, without: Figures) -> str:
    """How the voxel loss changes 2D maps here and in the paper, in words."""
    change = difference(value(without, "codeword.per_view.miou"), value(full, "codeword.per_view.miou"))
    if change is None:
        return "Voxel loss and 2D maps: –"
    here = f"Without it the 2D mIoU of the paper's own map changes by {change:+.3f} here and by +0.003 in the paper"
    return f"{here}: {'the same sign' if change > 0 else 'the sign differs'}."


def _lidar_and_selection(results: Results) -> str:
    parts = ["## 3D and selection"]
    places = {
        f"street, seed {TUNED_STREET_SEED}": (STREET, "6", "sam-v1"),
        "PandaSet 002, `annotations`": (PANDASET, "6", "annotations"),
    }
    keys = {title: f"lidar.{key}" for key, title in LIDAR_TITLES.items()}
    keys |= {"shared codes": "shared_codes"} | {title: f"click.{key}" for key, title in CLICK_TITLES.items()}
    keys |= {"ID switches": "scene.id_switches", "Acc@.25": "scene.acc25", "Acc@.5": "scene.acc50"}
    keys |= {"things": "scene.miou_things", "stuff": "scene.miou_stuff"}
    for name, place in places.items():
        rows = [
            [title, *(format_value(value(results.figures(*place, method, variant, row), key)) for key in keys.values())]
            for title, method, variant, row in list_method_rows(results, [place])
        ]
        rows += _list_bound_rows(results, place, keys)
        parts.append(table([name, *keys], rows))
    parts.append("Things, stuff: scene mIoU of each. Shared codes: codes that count for several objects.")
    return "\n\n".join(parts)


def reference_key(key: str) -> str:
    """The key of what true IDs reach: ``lidar.ap`` → ``lidar.reference_ap``."""
    part, _, name = key.rpartition(".")
    return f"{part}.reference_{name}" if part else f"reference_{name}"


def _cost(results: Results) -> str:
    rows = []
    for clip in (STREET, PANDASET):
        masks = "sam-v1" if clip == STREET else "annotations"
        for title, name in {
            "geometry and ours": f"{clip}/6/geometry",
            "Gaussian Grouping": f"{clip}/6/{masks}/gaussian-grouping",
            "OpenGaussian": f"{clip}/6/{masks}/opengaussian",
            "mask graph": f"{clip}/6/{masks}/mask-graph",
            "printed forms": f"{clip}/6/{masks}/paper",
        }.items():
            outcome = results.outcomes.get(name, {})
            figures = [
                format_value(outcome.get(key), 0) for key in ("train_seconds", "peak_rss_mb", "n_gaussians", "seconds")
            ]
            rows.append([f"{clip}: {title}", *figures])
    total = sum(outcome.get("seconds", 0.0) for outcome in results.outcomes.values())
    head = ["6 cameras", "training (s)", "peak memory (MB)", "Gaussians", "whole cell (s)"]
    return f"## Cost\n\n{table(head, rows)}\n\nAll cells together took {total / 60:.0f} minutes."


def _figures(results: Results) -> str:
    parts = ["## Figures"]
    for cell in results.cells:
        if cell.kind == "figure" and cell.name in results.images:
            caption = results.outcomes[cell.name]["caption"]
            parts.append(f"![{caption}]({results.images[cell.name]})\n\n*{caption}*")
    return "\n\n".join(parts)


def _list_names(numbers: Sequence[int]) -> str:
    *first, last = map(str, numbers)
    return f"{', '.join(first)} and {last}" if first else last
