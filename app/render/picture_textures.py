"""Textures for pictures other than splats: photos and masks."""

from __future__ import annotations

import moderngl
from jaxtyping import UInt8
from numpy import ndarray


class PictureTextures:
    """Keeps one texture per place of use and uploads a picture when the place shows another one."""

    def __init__(self, ctx: moderngl.Context) -> None:
        self._ctx = ctx
        self._shown: dict[str, tuple[UInt8[ndarray, "h w 4"], moderngl.Texture]] = {}
        self._retired: list[moderngl.Texture] = []

    def show(self, place: str, picture: UInt8[ndarray, "h w 4"]) -> int:
        """Return the GL name of a texture that holds `picture` (RGBA, row 0 at the top)."""
        before = self._shown.get(place)
        if before is not None and before[0] is picture:
            return before[1].glo
        size = (picture.shape[1], picture.shape[0])
        if before is not None and before[1].size == size:
            texture = before[1]
            texture.write(picture.tobytes(), alignment=1)
        else:
            if before is not None:
                self._retired.append(before[1])
            texture = self._ctx.texture(size, 4, picture.tobytes(), alignment=1)
            texture.repeat_x = texture.repeat_y = False
        self._shown[place] = (picture, texture)
        return texture.glo

    def free_retired(self) -> None:
        """Free textures no longer shown. Call it between window frames: draw lists name textures by reused numbers."""
        for texture in self._retired:
            texture.release()
        self._retired.clear()

    def release(self) -> None:
        """Free everything on the GPU."""
        self.free_retired()
        for _, texture in self._shown.values():
            texture.release()
        self._shown.clear()
