"""Photos on a GPU: sent once, gone with the array that they are a copy of, never more than the budget."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from numpy import ndarray
from tiny_training import new_trainer, tiny_config
from torch_splatting import TorchSplatting

from instdrive_core.training.backends.gsplat_backend import GsplatBackend
from instdrive_core.training.backends.sent_arrays import SentArrays


def copy_of(array: ndarray) -> torch.Tensor:
    return torch.from_numpy(array.copy())


def test_an_array_is_sent_once_and_leaves_with_its_copy() -> None:
    sent = SentArrays(lambda: 1000)
    first, second = np.full(100, 1, np.uint8), np.full(200, 2, np.uint8)
    for _ in range(3):
        assert sent.find_or_send(first, copy_of).tolist() == first.tolist()
        assert sent.find_or_send(second, copy_of).tolist() == second.tolist()
    assert (sent.sent_count, sent.kept_bytes) == (2, 300)
    del first
    assert sent.kept_bytes == 200
    del second
    assert sent.kept_bytes == 0


def test_another_array_in_the_place_of_a_dead_one_is_not_taken_for_it() -> None:
    sent = SentArrays(lambda: 10_000)
    for value in range(200):  # memory, and with it the number of an object, is used again at once
        assert sent.find_or_send(np.full(16, value, np.uint8), copy_of)[0] == value


def test_the_longest_unused_leaves_first_and_nothing_exceeds_the_budget() -> None:
    sent = SentArrays(lambda: 250)
    arrays = [np.full(100, value, np.uint8) for value in range(3)]
    for number in (0, 1, 0, 2):  # the third takes the place of the second
        sent.find_or_send(arrays[number], copy_of)
        assert sent.kept_bytes <= 250
    sent.find_or_send(arrays[0], copy_of)
    assert sent.sent_count == 3
    sent.find_or_send(arrays[1], copy_of)
    assert sent.sent_count == 4
    large = np.zeros(251, np.uint8)
    sent.find_or_send(large, copy_of)
    assert sent.kept_bytes == 200, "it would take the place of all others for nothing"


def test_steps_send_each_photo_once_where_the_memory_suffices() -> None:
    """Four photos with their skies and what is solid; the losses are the same as where each step sends its own."""
    config = tiny_config()
    config = replace(config, geometry=replace(config.geometry, iterations=8, coarse_iterations=0))
    losses, counts = [], []
    for budget in (1 << 20, 0):
        backend = GsplatBackend(torch.device("cpu"), TorchSplatting(), budget)
        trainer, _ = new_trainer(config, backend)
        for _ in range(8):
            trainer.rgb_step()
            trainer.iteration += 1
        losses.append(trainer.read_losses().terms)
        counts.append(backend.photos.sent_count)
    assert losses[0] == losses[1]
    assert counts == [12, 24]
