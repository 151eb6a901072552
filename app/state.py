"""What the user wants to see, and the frozen snapshot of it for each frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from jaxtyping import Float64
from numpy import ndarray

from instdrive_core.filming.camera_path import CameraKey
from instdrive_core.scene.camera import Camera, PhotoLag, look_at

DEFAULT_ID_OPACITY = 0.3
"""Splats fainter than this are not drawn in the ID view and cannot be picked."""
ID_ALPHA_CUT = 0.2
"""Alpha below which fragments are holes in the ID view."""


LINE_WIDTH = 2
"""Width of outlines, in pixels at scale 1."""


class ViewMode(Enum):
    """What the viewport draws."""

    COLOR = "Colour"
    INSTANCE = "Instances"
    CODEWORD = "Codewords"
    DEPTH = "Depth"
    CENTERS = "Centres"
    RINGS = "Rings"


SPLAT_MODES = (ViewMode.CENTERS, ViewMode.RINGS)
"""View modes that show single splats, before a plain backdrop."""


class Reference(Enum):
    """What the view of a dataset camera is compared with."""

    NONE = "Splats only"
    PHOTO = "Photo"
    MASKS = "Masks"


class Comparison(Enum):
    """How photo or masks are compared with the splats."""

    OVER = "Over the splats"
    BESIDE = "Side by side"
    WIPE = "Wipe"
    FLICKER = "Flicker"
    ERROR = "Heat map of the difference"


@dataclass(frozen=True)
class Intrinsics:
    """Pinhole intrinsics of a film, in pixels; the film is fitted into the viewport that shows it."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    @classmethod
    def from_camera(cls, camera: Camera) -> Intrinsics:
        """Take the intrinsics of a posed camera."""
        return cls(camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height)

    @classmethod
    def from_field_of_view(cls, degrees: float, width: int = 1600, height: int = 900) -> Intrinsics:
        """Compute centred intrinsics with a vertical field of view in degrees."""
        focal = height / 2 / np.tan(np.radians(degrees) / 2)
        return cls(focal, focal, width / 2, height / 2, width, height)


@dataclass(frozen=True)
class Viewpoint:
    """Where the user looks from, and the distance of the point that orbiting turns about."""

    world_from_camera: Float64[ndarray, "4 4"]
    lens: Intrinsics
    pivot_distance: float = 10.0
    """Metres along the viewing axis."""
    lag: PhotoLag | None = None
    """That of the photo whose camera is looked through."""
    zoom: float = 1.0
    """Times that the picture is larger than through `lens`: what is far is looked at like that, not from nearby."""

    @property
    def position(self) -> Float64[ndarray, "3"]:
        """Camera centre."""
        return self.world_from_camera[:3, 3]

    @property
    def forward(self) -> Float64[ndarray, "3"]:
        """Unit viewing direction."""
        return self.world_from_camera[:3, 2]

    @property
    def pivot(self) -> Float64[ndarray, "3"]:
        """The point that orbiting turns about."""
        return self.position + self.pivot_distance * self.forward

    def fit_camera(self, width: int, height: int) -> Camera:
        """Compute the camera of a viewport of this size in pixels: the whole film is inside and centred."""
        lens = self.lens
        scale = min(width / lens.width, height / lens.height)
        cx = lens.cx * scale + (width - lens.width * scale) / 2
        cy = lens.cy * scale + (height - lens.height * scale) / 2
        fx, fy = (focal * scale * self.zoom for focal in (lens.fx, lens.fy))
        return Camera(fx, fy, cx, cy, width, height, self.world_from_camera, self.lag)

    def make_film_camera(self) -> Camera:
        """Make the camera that exposes the film, in the film's pixels."""
        return replace(self, lag=None).fit_camera(self.lens.width, self.lens.height)

    def fit_film(self, width: int, height: int) -> tuple[float, float, float, float]:
        """Compute left, top, right and bottom of the film in a viewport of this size, in pixels."""
        scale = min(width / self.lens.width, height / self.lens.height)
        left, top = (width - self.lens.width * scale) / 2, (height - self.lens.height * scale) / 2
        return left, top, width - left, height - top


def make_default_viewpoint() -> Viewpoint:
    """Make a viewpoint near eye height that looks along the world's +y."""
    pose = look_at(np.array([0.0, -8.0, 3.0]), np.array([0.0, 0.0, 1.0]))
    return Viewpoint(pose, Intrinsics.from_field_of_view(50.0))


@dataclass(frozen=True)
class Stack:
    """The instances at one place of the picture, front to back, of which the user has gone through some."""

    ids: tuple[int, ...]
    chosen: int
    """Index of the one that is selected."""
    place: tuple[float, float]
    """Pixels of the picture."""
    pose: bytes
    """The camera's, as bytes: the list holds for this view only."""


@dataclass
class EditorState:
    """Everything but edits that changes the picture. Written by actions, tools and panels."""

    view_mode: ViewMode = ViewMode.COLOR
    time: float = 0.0
    """Seconds since the clip's first time step."""
    viewpoint: Viewpoint = field(default_factory=make_default_viewpoint)
    dataset_view: int | None = None
    """Index into the scene's views while the viewport looks through one of them, else None."""
    hovered: int = 0
    """Instance under the cursor; 0 = none."""
    stack: Stack | None = None
    """What lies behind each other where the user has clicked again; None unless that is listed."""
    picture_size: tuple[int, int] = (1280, 720)
    """Width and height, in pixels of the screen, at which the view is shown."""
    pixel_scale: float = 1.0
    """Pixels of the picture for one at scale 1, in which tools measure how far the mouse reaches."""
    path_keys: tuple[CameraKey, ...] = ()
    """Keys of the camera's path, in the film's order."""
    cut_out_screenshots: bool = False
    """Whether screenshots are see-through where no splat is."""
    tool: str = "pick"
    """Name of the tool in the user's hand."""
    region_splats: bool = False
    """Whether region tools select single splats instead of whole instances."""
    region_visible_only: bool = True
    """Whether region tools leave out what is hidden behind something."""
    brush_radius: float = 24.0
    """Pixels at scale 1."""
    brush_depth: float = 1.0
    """Metres behind what is seen that the brush reaches."""
    color_tolerance: float = 0.1
    """Difference of colours, 0 … 1 in each channel, up to which they are alike."""
    id_opacity: float = DEFAULT_ID_OPACITY
    show_sky: bool = True
    plain_solo: bool = True
    """Whether what is shown alone stands before a plain backdrop instead of the sky."""
    is_solo: bool = False
    """Whether instances are shown alone; the session keeps it up to date."""
    show_outlines: bool = True
    safe_colors: bool = False
    """Whether instances are shown in colours that colour-blind eyes tell apart; a preference."""
    shows_first_steps: bool = False
    """Whether the first steps lie over the picture."""
    show_grid: bool = False
    """Whether a grid lies on the ground."""
    stay_above_ground: bool = True
    """Whether orbiting stops above the ground."""
    reference: Reference = Reference.NONE
    reference_opacity: float = 0.5
    comparison: Comparison = Comparison.OVER
    """How photo or masks are shown with the splats."""
    wipe: float = 0.5
    """Share of the film's width, from the left, that a wipe shows of the photo or the masks."""
    show_cameras: bool = False
    """Whether the photos' cameras are drawn where they stood at the shown time."""
    show_all_cameras: bool = False
    """Whether that is done for all moments at once."""
    map_fits: int = 0
    """How often the map was asked to show everything."""
    hovered_camera: int | None = None
    """Index of the view whose drawn camera is under the mouse."""

    @property
    def compares(self) -> bool:
        """Whether the view looks through a dataset camera and shows its photo or masks."""
        return self.reference is not Reference.NONE and self.dataset_view is not None

    @property
    def draws_sky(self) -> bool:
        """Whether the sky is drawn behind the splats."""
        return self.show_sky and not (self.is_solo and self.plain_solo)


@dataclass(frozen=True)
class FrameSnapshot:
    """Everything that the renderer reads of the state, for one frame."""

    camera: Camera
    time: float
    view_mode: ViewMode
    hovered: int
    id_opacity: float
    show_sky: bool
    show_outlines: bool
    draft: bool
    """Draw coarsely because the camera is moving."""
    safe_colors: bool
    """Show instances in colours that colour-blind eyes tell apart."""
    line_width: int
    """Width of outlines, in pixels of the picture."""


def resolve(state: EditorState, width: int, height: int, draft: bool = False) -> FrameSnapshot:
    """Resolve `state` to one frame of a viewport of this size (pixels, at least 1 × 1).

    Beside a photo, what moves is shown where the photo has it; else where it is at the shown time.
    """
    camera = state.viewpoint.fit_camera(max(width, 1), max(height, 1))
    return FrameSnapshot(
        camera=camera if state.compares else replace(camera, lag=None),
        time=state.time,
        view_mode=state.view_mode,
        hovered=state.hovered,
        id_opacity=state.id_opacity,
        show_sky=state.draws_sky and state.view_mode not in SPLAT_MODES,
        show_outlines=state.show_outlines,
        draft=draft,
        safe_colors=state.safe_colors,
        line_width=max(1, round(LINE_WIDTH * state.pixel_scale)),
    )
