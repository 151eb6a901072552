"""Every panel and every dialog, made for one window: a new one is a file and a line here."""

from __future__ import annotations

from typing import NamedTuple, Protocol, runtime_checkable

from instdrive_app.panels.dialogs import DialogHost
from instdrive_app.panels.dialogs.about import AboutDialog
from instdrive_app.panels.dialogs.changed_scene import ChangedSceneDialog
from instdrive_app.panels.dialogs.command_palette import CommandPalette
from instdrive_app.panels.dialogs.dropped import DroppedDialog
from instdrive_app.panels.dialogs.file_browser import FileBrowser
from instdrive_app.panels.dialogs.findings import FindingsDialog
from instdrive_app.panels.dialogs.other_save import OtherSaveDialog
from instdrive_app.panels.dialogs.reassign import ReassignDialog
from instdrive_app.panels.dialogs.recovery import RecoveryDialog
from instdrive_app.panels.dialogs.rename import RenameDialog
from instdrive_app.panels.dialogs.set_class import ClassDialog
from instdrive_app.panels.dialogs.shortcuts import ShortcutSheet
from instdrive_app.panels.dialogs.split import SplitDialog
from instdrive_app.panels.dialogs.too_large import TooLargeDialog
from instdrive_app.panels.dialogs.turn_upright import TurnUprightDialog
from instdrive_app.panels.dialogs.unsaved import UnsavedDialog
from instdrive_app.panels.history import HistoryPanel
from instdrive_app.panels.inspector.panel import InspectorPanel
from instdrive_app.panels.instances.panel import InstancesPanel
from instdrive_app.panels.log import LogPanel
from instdrive_app.panels.overlays.camera_tag import CameraTag
from instdrive_app.panels.overlays.deletion import DeletionOverlay
from instdrive_app.panels.overlays.depth_legend import DepthLegend
from instdrive_app.panels.overlays.first_picture import FirstPictureNotice
from instdrive_app.panels.overlays.gizmo import Gizmo
from instdrive_app.panels.overlays.hover_label import HoverLabel
from instdrive_app.panels.overlays.opacity_slider import OpacitySlider
from instdrive_app.panels.overlays.region_outline import RegionOutline
from instdrive_app.panels.overlays.view_switch import ViewSwitch
from instdrive_app.panels.timeline import TimelinePanel
from instdrive_app.panels.toolbar import Toolbar
from instdrive_app.panels.viewport import ViewportPanel
from instdrive_app.panels.widgets.ui import Ui


@runtime_checkable
class Panel(Protocol):
    """What fills a docked window."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""


class DockedPanel(NamedTuple):
    """A panel and where it is until the user moves it."""

    name: str
    """On its tab."""
    place: str
    """A dock space of `window_layout`."""
    panel: Panel


VIEW = "View"
"""The panel with the picture."""


def create_panels() -> tuple[DockedPanel, ...]:
    """The panels, in the order of their tabs."""
    beneath = (FirstPictureNotice(), DeletionOverlay())
    above = (
        ViewSwitch(),
        Toolbar(),
        CameraTag(),
        DepthLegend(),
        OpacitySlider(),
        HoverLabel(),
        RegionOutline(),
    )
    return (
        DockedPanel(VIEW, "MainDockSpace", ViewportPanel(beneath, Gizmo(), above)),
        DockedPanel("Instances", "Right", InstancesPanel()),
        DockedPanel("Inspector", "RightBottom", InspectorPanel()),
        DockedPanel("History", "RightBottom", HistoryPanel()),
        DockedPanel("Timeline", "Bottom", TimelinePanel()),
        DockedPanel("Log", "Bottom", LogPanel()),
    )


def create_dialogs() -> DialogHost:
    """The dialogs, none of them open."""
    return DialogHost(
        (
            FileBrowser(),
            RenameDialog(),
            ClassDialog(),
            SplitDialog(),
            ReassignDialog(),
            ShortcutSheet(),
            AboutDialog(),
            CommandPalette(),
            UnsavedDialog(),
            RecoveryDialog(),
            DroppedDialog(),
            ChangedSceneDialog(),
            OtherSaveDialog(),
            TooLargeDialog(),
            FindingsDialog(),
            TurnUprightDialog(),
        )
    )
