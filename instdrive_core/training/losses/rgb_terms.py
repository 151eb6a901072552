"""Loss terms of the RGB stage: what one rendered photo is compared with."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from instdrive_core.training.backends.backend import Backend
from instdrive_core.training.gaussians.exposures import exposure_penalty
from instdrive_core.training.gaussians.view_rendering import RenderedView
from instdrive_core.training.instances.named_masks import ObjectTags
from instdrive_core.training.losses.loss_term import LossTerm
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.views.training_view import TrainingView


@dataclass
class RgbStep:
    """One photo, and what the model shows in its place."""

    config: TrainConfig
    backend: Backend
    number: int
    """Number of the view in its store."""
    view: TrainingView
    rendered: RenderedView
    image: Float[Tensor, "h w 3"]
    """Rendered colour with the sky behind it, exposed as the photo."""
    exposures: Float[Tensor, "v 3 4"]
    """Exposures of all photos."""
    tags: ObjectTags | None = None
    """Tags of the objects that the view's masks show; None where no edges are learned."""
    psnr: Float[Tensor, ""] | float = float("nan")
    """PSNR of `image` in dB; the photometric term writes it."""


def _compare_with_photo(step: RgbStep, weight: float) -> Tensor:
    del weight
    share = step.config.geometry.ssim_weight
    loss, step.psnr = step.backend.photometric_loss(step.image, step.view.image, step.view.valid, share)
    return loss


def _compare_with_lidar(step: RgbStep, weight: float) -> Tensor:
    view, rendered = step.view, step.rendered
    return weight * step.backend.depth_loss(rendered.depth, rendered.alpha, view.depth_pixels, view.depth_values)


def _clear_sky(step: RgbStep, weight: float) -> Tensor:
    assert step.view.sky is not None
    return weight * step.backend.opacity_loss(step.rendered.alpha, step.view.sky, solid=False)


def _fill_masks(step: RgbStep, weight: float) -> Tensor:
    assert step.view.solid is not None
    return weight * step.backend.opacity_loss(step.rendered.alpha, step.view.solid, solid=True)


def _keep_objects_apart(step: RgbStep, weight: float) -> Tensor:
    """Compare what is blended of the objects' tags with the tag of the one that the pixel's mask shows, as opaque as
    the pixel is: whatever else shows there has too much weight, but for the shadows of moving objects: a mask shows
    what they fall on."""
    tags, drawn = step.tags, step.rendered.tags
    assert tags is not None
    assert drawn is not None
    shown, shadow = drawn[..., :-1], drawn[..., -1]
    foreign = (shown - tags.wanted * (step.rendered.alpha - shadow)[..., None]).abs() * tags.known[..., None]
    return weight * foreign.mean()


def _hold_exposures(step: RgbStep, weight: float) -> Tensor:
    return weight * exposure_penalty(step.exposures, step.number)


RGB_TERMS: tuple[LossTerm[RgbStep], ...] = (
    LossTerm(
        name="rgb",
        meaning="the picture is the photo: (1 - w) L1 + w (1 - SSIM), w = `geometry.ssim_weight`",
        stage="rgb",
        needs="photos",
        weight_field=None,
        compute=_compare_with_photo,
        is_due=lambda step: True,
    ),
    LossTerm(
        name="depth",
        meaning="expected depth is that of LiDAR points, L1 in metres",
        stage="rgb",
        needs="LiDAR",
        weight_field="geometry.depth_weight",
        compute=_compare_with_lidar,
        is_due=lambda step: len(step.view.depth_pixels) > 0,
    ),
    LossTerm(
        name="sky",
        meaning="nothing hides the sky: cross-entropy of alpha towards 0 inside the sky mask",
        stage="rgb",
        needs="sky masks",
        weight_field="geometry.sky_weight",
        compute=_clear_sky,
        is_due=lambda step: step.view.sky is not None,
    ),
    LossTerm(
        name="solid",
        meaning="what masks show stands before the sky: cross-entropy of alpha towards 1 inside instance masks",
        stage="rgb",
        needs="instance masks",
        weight_field="geometry.solid_weight",
        compute=_fill_masks,
        is_due=lambda step: step.view.solid is not None,
    ),
    LossTerm(
        name="edge",
        meaning="nothing of other objects shows in an object's masks: tags, drawn anew each step, blend to its own",
        stage="rgb",
        needs="instance masks",
        weight_field="geometry.edge_weight",
        compute=_keep_objects_apart,
        is_due=lambda step: step.tags is not None,
    ),
    LossTerm(
        name="exposure",
        meaning="exposures stay near the identity, singly and in the mean",
        stage="rgb",
        needs="photos",
        weight_field="geometry.exposure_weight",
        compute=_hold_exposures,
        is_due=lambda step: step.config.geometry.exposure_lr != 0,
    ),
)
