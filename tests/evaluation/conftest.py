"""Fixtures of the evaluation's tests."""

import pytest
from evaluation_scene import ToyDrive, toy_drive


@pytest.fixture
def drive() -> ToyDrive:
    """A fresh toy drive that a test may spoil."""
    return toy_drive()
