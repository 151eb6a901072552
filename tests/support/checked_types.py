"""The checker that wraps every function while tests run; see conftest.py."""

from io import BufferedIOBase
from typing import IO

from beartype import BeartypeConf, FrozenDict, beartype

OVERRIDES = FrozenDict({IO[bytes]: IO[bytes] | BufferedIOBase})
"""What `zipfile` opens is IO[bytes] to type checkers, but lacks some of its methods."""
check_types = beartype(conf=BeartypeConf(is_pep484_tower=True, hint_overrides=OVERRIDES))
"""Lets an int stand for a float, as PEP 484 does."""
