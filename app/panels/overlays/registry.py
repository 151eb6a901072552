"""Every overlay of the viewport: a new one is a file and a line here."""

from __future__ import annotations

from instdrive_app.panels.overlays import Handles, Overlay, OverlayRecord
from instdrive_app.panels.overlays.box import BoxOverlay
from instdrive_app.panels.overlays.brush_ring import BrushRing
from instdrive_app.panels.overlays.camera_tag import CameraTag
from instdrive_app.panels.overlays.cameras import CamerasOverlay
from instdrive_app.panels.overlays.deletion import DeletionOverlay
from instdrive_app.panels.overlays.depth_legend import DepthLegend
from instdrive_app.panels.overlays.first_picture import FirstPictureNotice
from instdrive_app.panels.overlays.first_steps import FirstSteps
from instdrive_app.panels.overlays.gizmo import Gizmo
from instdrive_app.panels.overlays.ground_grid import GridOverlay
from instdrive_app.panels.overlays.hover_label import HoverLabel
from instdrive_app.panels.overlays.opacity_slider import OpacitySlider
from instdrive_app.panels.overlays.path_keys import PathKeysOverlay
from instdrive_app.panels.overlays.reference import ReferenceOverlay
from instdrive_app.panels.overlays.region_outline import RegionOutline
from instdrive_app.panels.overlays.ruler import RulerOverlay
from instdrive_app.panels.overlays.stack_list import StackList
from instdrive_app.panels.overlays.toolbar import Toolbar
from instdrive_app.panels.overlays.upright_bar import UprightBar
from instdrive_app.panels.overlays.view_switch import ViewSwitch

BELOW_HANDLES: tuple[OverlayRecord[Overlay], ...] = (
    OverlayRecord("Photo and masks", "ICON_FA_IMAGE", ReferenceOverlay),
    OverlayRecord("Notice of the first picture", "ICON_FA_HOURGLASS_HALF", FirstPictureNotice),
    OverlayRecord("Grid on the ground", "ICON_FA_BORDER_ALL", GridOverlay),
    OverlayRecord("Cameras of the clip", "ICON_FA_CAMERA", CamerasOverlay),
    OverlayRecord("Box", "ICON_FA_CUBE", BoxOverlay),
    OverlayRecord("Keys of a way", "ICON_FA_ROUTE", PathKeysOverlay),
    OverlayRecord("Measured line", "ICON_FA_RULER_COMBINED", RulerOverlay),
    OverlayRecord("Review of a deletion", "ICON_FA_BROOM", DeletionOverlay),
)
"""Drawn first, in this order."""
HANDLES: OverlayRecord[Handles] = OverlayRecord("Handles", "ICON_FA_UP_DOWN_LEFT_RIGHT", Gizmo)
ABOVE_HANDLES: tuple[OverlayRecord[Overlay], ...] = (
    OverlayRecord("View modes", "ICON_FA_EYE", ViewSwitch),
    OverlayRecord("Toolbar", "ICON_FA_TOOLBOX", Toolbar),
    OverlayRecord("Camera", "ICON_FA_VIDEO", CameraTag),
    OverlayRecord("Scale of depths", "ICON_FA_RULER", DepthLegend),
    OverlayRecord("Minimum opacity", "ICON_FA_SLIDERS", OpacitySlider),
    OverlayRecord("Label of the hovered instance", "ICON_FA_COMMENT", HoverLabel),
    OverlayRecord("What lies behind each other", "ICON_FA_LAYER_GROUP", StackList),
    OverlayRecord("Question which way is up", "ICON_FA_ARROWS_SPIN", UprightBar),
    OverlayRecord("First steps", "ICON_FA_SHOE_PRINTS", FirstSteps),
    OverlayRecord("Outline of a region", "ICON_FA_DRAW_POLYGON", RegionOutline),
    OverlayRecord("Ring of the brush", "ICON_FA_CIRCLE", BrushRing),
)
"""Drawn last, in this order."""
OVERLAYS: tuple[OverlayRecord[Overlay], ...] = (*BELOW_HANDLES, HANDLES, *ABOVE_HANDLES)
"""All overlays in the order of drawing."""
