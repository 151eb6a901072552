"""Interface of a method that learns instances on finished geometry; other methods than our own plug in here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from jaxtyping import Float32, UInt32
from numpy import ndarray

from instdrive_core.instances.codebook import quantize_features
from instdrive_core.maths.streams import Stream, make_generator
from instdrive_core.training.gaussians.model import SceneModel
from instdrive_core.training.instances.feature_weights import CachedView, cache_view
from instdrive_core.training.instances.instance_losses import sample_stratified_pixels
from instdrive_core.training.settings.config import TrainConfig
from instdrive_core.training.views.view_store import ViewStore


@dataclass(frozen=True)
class LearnedInstances:
    """A method's result: a codeword per Gaussian, before spatial components tell apart what shares one."""

    codewords: UInt32[ndarray, " n"]
    """Equal numbers = the method takes them for one instance."""
    features: Float32[ndarray, "n d"]
    """Features that the method learned per Gaussian; the scene keeps them."""
    code_bits: int
    """d where codewords are those of the codebook {-1, 1}^d, quantised from the features; 0 where they are plain
    numbers, of which the rendered features tell nothing."""
    whole: bool = False
    """Each codeword is one instance already, wherever its Gaussians are; off: spatial components tell apart what
    shares a codeword."""


@runtime_checkable
class InstanceLearner(Protocol):
    """A method: learns from the training views' masks, changes neither the model nor the store."""

    def __call__(
        self, model: SceneModel, store: ViewStore, config: TrainConfig, on_note: Callable[[str], None]
    ) -> LearnedInstances:
        """Learn; `on_note` is told, in a line each, what a user should know (stages, sizes).

        The same model, views and `config.seed` give the same bits.
        """
        ...


def read_codewords(features: Float32[ndarray, "n d"]) -> LearnedInstances:
    """Read instances off trained features, as the paper does: the nearest codeword of each Gaussian."""
    return LearnedInstances(quantize_features(features), features, features.shape[1])


def cache_views(model: SceneModel, store: ViewStore, config: TrainConfig) -> list[CachedView]:
    """Cache the blending weights of sampled masked pixels of each view that has any; the model is on the CPU.

    The sample is the same for every method (stratified over masks, seeded by `config.seed` and the view's number).
    """
    instances, cached = config.instances, []
    for number in range(len(store)):
        store.prefetch([(ahead, False) for ahead in range(number + 1, min(number + 3, len(store)))])
        view = store.get(number)
        if view.labels is None or not view.labels.any():
            continue
        rng = make_generator(config.seed, Stream.MASKED_PIXELS, number)
        pixels = sample_stratified_pixels(view.labels, instances.pixels_per_view, rng)
        cached.append(cache_view(model, view, number, pixels, instances.min_alpha))
    store.release()
    return cached
