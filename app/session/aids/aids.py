"""All aids of a session."""

from __future__ import annotations

from instdrive_app.session.aids.bookmarks import Bookmarks
from instdrive_app.session.aids.box_controller import BoxController
from instdrive_app.session.aids.ruler import Ruler
from instdrive_app.session.context import SessionContext
from instdrive_core.scene.transforms import Similarity


class Aids:
    """Kept views, the box and the ruler of the open document."""

    def __init__(self, context: SessionContext) -> None:
        self.bookmarks, self.box, self.ruler = Bookmarks(), BoxController(context), Ruler()

    def forget(self) -> None:
        """Forget everything, since another document is open."""
        self.bookmarks.clear()
        self.box.forget()
        self.ruler.clear()

    def follow_scene(self, matrix: Similarity) -> None:
        """Go along with the scene, which was transformed by [s R | t] as a whole."""
        self.bookmarks.follow_scene(matrix)
        self.ruler.points = tuple(matrix[:, :3] @ point + matrix[:, 3] for point in self.ruler.points)
        if self.box.box is not None:
            self.box.box = self.box.box.transform(matrix)
