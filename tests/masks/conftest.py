"""Shared by the tests of Segment Anything: tiny models on disk, which tests only read."""

import pytest
import torch
from tiny_sam import CONFIGS, write_tiny_model


@pytest.fixture(scope="module")
def one_thread():
    """Tiny tensors are faster without others' help."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


@pytest.fixture(scope="session", params=list(CONFIGS))
def model_folder(request, tmp_path_factory):
    return write_tiny_model(tmp_path_factory.mktemp(request.param), request.param)


@pytest.fixture(scope="session")
def sam_folder(tmp_path_factory):
    return write_tiny_model(tmp_path_factory.mktemp("sam"), "sam")
