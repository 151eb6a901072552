"""The checker that wraps every function while tests run; see conftest.py."""

from beartype import BeartypeConf, beartype

check_types = beartype(conf=BeartypeConf(is_pep484_tower=True))
"""Lets an int stand for a float, as PEP 484 does."""
