"""Whether a scene shows what photos show: pictures of it, drawn from where the photos were taken, are compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray
from scipy import ndimage

from instdrive_core.datasets.clip import Clip, Frame
from instdrive_core.errors import DataError
from instdrive_core.finding.placement import place_scene
from instdrive_core.progress import report, report_span
from instdrive_core.rasterize.preview import Preview
from instdrive_core.rasterize.scene_view import view_scene
from instdrive_core.scene.scene import Scene
from instdrive_core.scene.transforms import Similarity

LEAST_LIKENESS, GOOD_LIKENESS = 0.4, 0.6
"""Correlation of detail below which a scene is another one or lies elsewhere, and from which all is well. A short
training of PandaSet has 0.92 with photos of the camera it was trained on and 0.80 with those of all six at its place,
0.64 half a metre beside it, 0.47 at 1 m, 0.23 at 3 m, and at most 0.14 where it is turned."""
LEAST_SHOWN = 0.05
"""Share of a photo that the scene must cover for the photo to be compared."""
_LOOKED_AT = 9
"""Photos, spread over the clip."""
_FINE, _COARSE = 1.0, 1 / 40
"""Detail is what lies between blurs of so many pixels and of this share of the width."""


@dataclass(frozen=True)
class PhotoLikeness:
    """How well pictures of a scene agree with photos."""

    likeness: float
    """Correlation of the detail of picture and photo, -1 … 1, photos weighted by how much of them the scene covers; 0
    where none shows it."""
    shown: float
    """Share of the photos' pixels that the scene covers."""

    @property
    def fits(self) -> bool:
        """Whether scene and photos belong together."""
        return self.likeness >= LEAST_LIKENESS


def choose_placement(
    scene: Scene, clip: Clip, placements: Sequence[Similarity], named: str
) -> tuple[Similarity, PhotoLikeness]:
    """Choose the first place, of some, at which a scene shows well what the photos of a clip show, else the best.

    Returns it, and how well scene and photos agree there. Reports its progress (`progress.report`).
    Raises DataError where it does at none, or a photo is damaged; `named` is what the user calls the scene.
    """
    frames = clip.training_frames
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), _LOOKED_AT)).round().astype(int))
    found: list[PhotoLikeness] = []
    for number, matrix in enumerate(placements):
        with report_span(number / len(placements), (number + 1) / len(placements)):
            found.append(measure_likeness(place_scene(scene, matrix, clip.origin), [frames[place] for place in chosen]))
        if found[-1].likeness >= GOOD_LIKENESS:
            break
    best = max(range(len(found)), key=lambda number: found[number].likeness)
    if found[best].fits:
        return placements[best], found[best]
    shown = max(one.shown for one in found)
    if shown < LEAST_SHOWN:
        problem = f"hardly any of the scene {named} lies before its cameras ({shown:.0%} of the photos show it)"
    else:
        problem = (
            f"its photos do not show the scene {named}: drawn from where they were taken, it agrees with them by "
            f"{max(found[best].likeness, 0.0):.2f}, and {LEAST_LIKENESS} is the least"
        )
    remedy = "Choose the photos and poses that the scene was trained with, in the same world: origin, axes and unit"
    raise DataError(clip.path, problem, remedy)


def measure_likeness(scene: Scene, frames: Sequence[Frame]) -> PhotoLikeness:
    """Measure how well a scene, in the world of some photos, agrees with them; sky and exposure do not count.

    Reports its progress (`progress.report`).
    """
    bare, likeness, shown = replace(scene, sky=None), [], []
    for number, frame in enumerate(frames):
        report(number / len(frames))
        drawn = view_scene(bare, frame.view.camera, frame.view.time)
        there = drawn.alpha > 0.5
        shown.append(float(there.mean()))
        if shown[-1] >= LEAST_SHOWN:
            likeness.append(compute_likeness(drawn, frame.load_image(), there))
    weights = np.array([share for share in shown if share >= LEAST_SHOWN])
    likely = float(weights @ np.array(likeness) / weights.sum()) if likeness else 0.0
    return PhotoLikeness(likely, float(np.mean(shown)) if shown else 0.0)


def compute_likeness(drawn: Preview, photo: UInt8[ndarray, "h w 3"], where: Bool[ndarray, "h w"]) -> float:
    """Correlate the detail, -1 … 1, of a picture without a sky and a photo `where` the scene covers them; 0 where it
    covers nothing.
    """
    there = drawn.alpha > 0.5
    if not (there & where).any():
        return 0.0
    picture = drawn.color.mean(axis=2) / np.maximum(drawn.alpha, 0.5)
    grey = photo.mean(axis=2, dtype=np.float32) / np.float32(255)
    compared = there & where
    return _correlate(_find_detail(picture, there)[compared], _find_detail(grey, there)[compared])


def _find_detail(grey: Float[ndarray, "h w"], there: Bool[ndarray, "h w"]) -> Float[ndarray, "h w"]:
    """Detail of the pixels that are `there`, of which alone the blurs are made."""

    def blur(width: float) -> Float[ndarray, "h w"]:
        weight = ndimage.gaussian_filter(there.astype(np.float32), width)
        return ndimage.gaussian_filter(np.where(there, grey, 0), width) / np.maximum(weight, 1e-3)

    return blur(_FINE) - blur(max(2 * _FINE, _COARSE * grey.shape[1]))


def _correlate(one: Float[ndarray, " p"], other: Float[ndarray, " p"]) -> float:
    one, other = one - one.mean(), other - other.mean()
    return float(one @ other / max(np.linalg.norm(one) * np.linalg.norm(other), 1e-12))
