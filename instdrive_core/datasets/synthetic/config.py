"""What a user may choose about a synthetic clip."""

from __future__ import annotations

from dataclasses import dataclass

from instdrive_core.errors import OptionError

CONFIG_FILE = "labels/street.json"
"""Where a clip keeps the config of its street."""
FLOWING, JAM = "flowing", "jam"
"""Traffic that a street may have."""
PANDAR64, HDL64, HDL32, VLP16 = LIDARS = ("pandar64", "hdl64", "hdl32", "vlp16")
"""Turning LiDARs whose beams a street may be recorded with: PandaSet's, KITTI's, nuScenes', and a smaller one."""
USUAL_RATE = 10
"""Time steps a second."""
MAX_STEPS = 400
"""Forty seconds, as a rule: the street is built as long as the drive needs it."""


@dataclass(frozen=True)
class RecordingFlaws:
    """What real recordings have and the standard clip does not. Truth in ``labels/`` stays exact."""

    shutter_seconds: float = 0.0
    """Time from a photo's first to its last row, while the car and the traffic move on; 0 = all rows at once."""
    position_noise: float = 0.0
    """Standard deviation in metres along each axis of written camera and LiDAR poses; photos and points stay."""
    rotation_noise: float = 0.0
    """Standard deviation in degrees about each axis of written camera and LiDAR poses."""
    exposure_stops: float = 0.0
    """Most stops by which a camera's exposure drifts up and down during the drive."""
    cuboid_error: float = 0.0
    """Metres by which cuboids are off, half of it constant for an object, half new at each step (root mean square)."""
    twin_cuboids: bool = False
    """Annotate what moves twice, as met by two LiDARs 12 to 60 ms apart, without naming the pairs."""

    def __post_init__(self) -> None:
        limits = {
            "shutter_seconds": 0.1,
            "position_noise": 1.0,
            "rotation_noise": 5.0,
            "exposure_stops": 3.0,
            "cuboid_error": 1.0,
        }
        for name, high in limits.items():
            value = getattr(self, name)
            if not 0 <= value <= high:
                raise OptionError(f"{name} is {value}; choose 0 to {high:g}")

    @property
    def spoils_poses(self) -> bool:
        """Whether written poses differ from the true ones."""
        return self.position_noise > 0 or self.rotation_noise > 0

    @property
    def spoils_cuboids(self) -> bool:
        """Whether the annotations differ from the true boxes."""
        return self.cuboid_error > 0 or self.twin_cuboids


@dataclass(frozen=True)
class StreetConfig:
    """A procedural street and how it is recorded. The same config gives the same files, byte for byte."""

    seed: int = 0
    """Chooses layout, models, colours, traffic and sun."""
    steps: int = 20
    """Time steps (1–400)."""
    width: int = 480
    """Width of the photos in pixels; PandaSet's are 1920×1080."""
    height: int = 270
    """Height of the photos in pixels."""
    lidar_azimuths: int = 1000
    """LiDAR columns per turn."""
    traffic: str = FLOWING
    """``flowing``, or ``jam``: three full lanes that stop and go, and no car parked on the right."""
    flaws: RecordingFlaws = RecordingFlaws()
    """How the recording falls short of the standard one."""
    lidar: str = PANDAR64
    """One of `LIDARS`."""
    rate: int = USUAL_RATE
    """Time steps a second, 1–20: turns of the LiDAR, and photos of each camera."""

    def __post_init__(self) -> None:
        limits = {
            "seed": (0, 2**32 - 1),
            "steps": (1, MAX_STEPS),
            "width": (16, 3840),
            "height": (9, 2160),
            "lidar_azimuths": (16, 4000),
            "rate": (1, 20),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise OptionError(f"{name} is {value}; choose {low} to {high}")
        if self.traffic not in (FLOWING, JAM):
            raise OptionError(f"traffic is {self.traffic!r}; choose '{FLOWING}' or '{JAM}'")
        if self.lidar not in LIDARS:
            raise OptionError(f"lidar is {self.lidar!r}; choose one of {', '.join(LIDARS)}")

    @property
    def step_seconds(self) -> float:
        """Seconds from one time step to the next."""
        return 1 / self.rate
