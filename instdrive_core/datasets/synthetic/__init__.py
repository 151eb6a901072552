"""A procedural street, written in PandaSet's layout."""

from instdrive_core.datasets.synthetic.config import RecordingFlaws, StreetConfig
from instdrive_core.datasets.synthetic.write import write_street

__all__ = ["RecordingFlaws", "StreetConfig", "write_street"]
