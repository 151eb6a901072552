"""A procedural street, written in PandaSet's layout."""

from instdrive_core.datasets.synthetic.config import StreetConfig
from instdrive_core.datasets.synthetic.write import write_street

__all__ = ["StreetConfig", "write_street"]
