"""Every docked panel: a new one is a file and a line here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from instdrive_app.panels.camera_path import CameraPathPanel
from instdrive_app.panels.driving.way_panel import WayPanel
from instdrive_app.panels.filter import FilterPanel
from instdrive_app.panels.history import HistoryPanel
from instdrive_app.panels.inspector.panel import InspectorPanel
from instdrive_app.panels.instances.panel import InstancesPanel
from instdrive_app.panels.log import LogPanel
from instdrive_app.panels.map.panel import MapPanel
from instdrive_app.panels.runs import RunsPanel
from instdrive_app.panels.timeline import TimelinePanel
from instdrive_app.panels.training import TrainingPanel
from instdrive_app.panels.viewport import ViewportPanel
from instdrive_app.panels.views import ViewsPanel
from instdrive_app.panels.widgets.ui import Ui


@runtime_checkable
class Panel(Protocol):
    """The content of a docked window."""

    def draw(self, ui: Ui) -> None:
        """Draw one frame."""


@dataclass(frozen=True)
class PanelRecord:
    """One docked panel, and where it is until the user moves it."""

    title: str
    """Title on its tab and in the Window menu."""
    icon: str
    """Name of an icon constant of Font Awesome 6."""
    place: str
    """Dock space of `shell/window_layout.py`."""
    create: Callable[[], Panel]
    shown: bool = True
    """Whether it is open until the user decides otherwise."""
    fills_window: bool = False
    """Whether it is drawn without padding, and is always there: then the Window menu does not list it."""
    shortcut: str = ""
    """Key that brings it to the front; empty: by its place in the Window menu, Alt+1 and so on, as far as they go."""


PANELS = (
    PanelRecord("View", "ICON_FA_IMAGE", "MainDockSpace", ViewportPanel, fills_window=True),
    PanelRecord("Instances", "ICON_FA_LIST", "Right", InstancesPanel),
    PanelRecord("Inspector", "ICON_FA_SLIDERS", "RightBottom", InspectorPanel),
    PanelRecord("History", "ICON_FA_CLOCK_ROTATE_LEFT", "RightBottom", HistoryPanel),
    PanelRecord("Timeline", "ICON_FA_FILM", "Bottom", TimelinePanel),
    PanelRecord("Log", "ICON_FA_RECEIPT", "Bottom", LogPanel),
    PanelRecord("Filter", "ICON_FA_FILTER", "RightBottom", FilterPanel, shown=False),
    PanelRecord("Views", "ICON_FA_BOOKMARK", "RightBottom", ViewsPanel, shown=False),
    PanelRecord("Training", "ICON_FA_CHART_LINE", "RightBottom", TrainingPanel, shown=False),
    PanelRecord("Runs", "ICON_FA_SCALE_BALANCED", "RightBottom", RunsPanel, shown=False),
    PanelRecord("Camera path", "ICON_FA_CLAPPERBOARD", "Bottom", CameraPathPanel, shown=False),
    PanelRecord("Map", "ICON_FA_MAP", "Beside", MapPanel, shown=False, shortcut="Alt+M"),
    PanelRecord("Way", "ICON_FA_ROUTE", "RightBottom", WayPanel, shown=False),
)
"""The panels, in the order of their tabs."""
