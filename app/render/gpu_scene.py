"""A document's arrays on the GPU, kept up to date by uploading only what changed."""

from __future__ import annotations

import moderngl
import numpy as np
from numpy import ndarray

from instdrive_app.render.programs import set_uniforms
from instdrive_app.render.splat_textures import WIDTH, ArrayTexture
from instdrive_core.edits.document import Document
from instdrive_core.instances.colormap import ID_LIMIT, colors_from_ids
from instdrive_core.maths.rotations import normalized
from instdrive_core.scene.scene import node_rotations, placed
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.sky import Sky

NOT_DRAWN = int(Flag.HIDDEN | Flag.DELETED)


class GpuScene:
    """Textures of one document. `update` brings them to the document's present state and a time."""

    def __init__(self, ctx: moderngl.Context, document: Document) -> None:
        self._ctx, self._document = ctx, document
        scene = document.scene
        self._geometry = ArrayTexture(ctx, _geometry_texels(document))
        self._harmonics, self._harmonic_texels = _harmonics_texture(ctx, document)
        self.states = ArrayTexture(ctx, document.state.flags)
        self._ids = scene.instance_ids.copy()
        self.instance_ids = ArrayTexture(ctx, self._ids)
        self.instance_colors = ArrayTexture(ctx, _id_colors(self._ids), normalized=True)
        self.codeword_colors = ArrayTexture(ctx, _id_colors(scene.codewords), normalized=True)
        self._indices = ArrayTexture(ctx, self._index_pairs())
        self._palette = ArrayTexture(ctx, _palette_texels(document))
        self._poses = ArrayTexture(ctx, np.zeros(((len(scene.actors) + 1) * 4, 4), np.float32))
        self.sky = sky_texture(ctx, scene.sky)
        self._hidden = document.state.flags & NOT_DRAWN
        self._versions = (document.state.version, document.colors.version, document.table_version)
        document.state.take_dirty()
        document.colors.take_dirty()
        self._time: float | None = None
        self.look_version = 0
        """Rises when the blended picture would change: visibility, colours, poses."""
        self.pose_version = 0
        """Rises when splats move."""
        self.id_version = 0
        """Rises when splats change instances."""
        self.means: ndarray = scene.gaussians.means
        """World positions (n, 3) at the time of the last update."""

    def __len__(self) -> int:
        return len(self._document.scene)

    def update(self, time: float) -> None:
        """Upload what changed since the last call, and the actors' poses at `time` (seconds)."""
        document = self._document
        versions = (document.state.version, document.colors.version, document.table_version)
        if versions[0] != self._versions[0]:
            self._update_states()
        if versions[1] != self._versions[1]:
            self._update_colors()
        if versions[2] != self._versions[2]:
            self._update_ids()
        self._versions = versions
        if time != self._time:
            self._update_poses(time)

    def bind(self, program: moderngl.Program) -> None:
        """Bind the textures that projection reads, to units 0 to 5."""
        named = {
            "geometry_texture": self._geometry,
            "sh_texture": self._harmonics,
            "index_texture": self._indices,
            "state_texture": self.states,
            "pose_texture": self._poses,
            "palette_texture": self._palette,
        }
        for unit, (name, array) in enumerate(named.items()):
            array.texture.use(unit)
            set_uniforms(program, **{name: unit})
        set_uniforms(
            program,
            texture_width=WIDTH,
            sh_texels=self._harmonic_texels,
            sh_rest_count=self._document.scene.gaussians.sh_rest.shape[1],
            hidden_flags=NOT_DRAWN,
        )

    def release(self) -> None:
        """Free all textures."""
        for array in (
            *(self._geometry, self._harmonics, self._indices, self._palette, self._poses),
            *(self.states, self.instance_ids, self.instance_colors, self.codeword_colors),
        ):
            array.release()
        if self.sky is not None:
            self.sky.release()

    def _update_states(self) -> None:
        dirty = self._document.state.take_dirty()
        if dirty is None:
            return
        flags, (start, stop) = self._document.state.flags, dirty
        self.states.write(flags, start, stop)
        hidden = flags[start:stop] & NOT_DRAWN
        if not np.array_equal(hidden, self._hidden[start:stop]):
            self._hidden[start:stop] = hidden
            self.look_version += 1

    def _update_colors(self) -> None:
        document = self._document
        dirty = document.colors.take_dirty()
        if dirty is not None:
            self._indices.write(self._index_pairs(), *dirty)
        texels = _palette_texels(document)
        if not self._palette.holds(len(texels)):
            self._palette.release()
            self._palette = ArrayTexture(self._ctx, texels)
        else:
            self._palette.write(texels, 0, len(texels))
        self.look_version += 1

    def _update_ids(self) -> None:
        ids = self._document.scene.instance_ids
        changed = np.flatnonzero(ids != self._ids)
        if not len(changed):
            return
        start, stop = int(changed[0]), int(changed[-1]) + 1
        self._ids = ids.copy()
        self.instance_ids.write(ids, start, stop)
        self.instance_colors.write(_id_colors(ids), start, stop)
        self.id_version += 1

    def _update_poses(self, time: float) -> None:
        scene = self._document.scene
        poses, present = scene.at(time)
        texels = np.zeros((len(poses), 4, 4), np.float32)
        texels[:, :3, :3] = node_rotations(poses)
        texels[:, :3, 3] = poses[:, :3, 3]
        texels[:, 3, 0] = present
        self._poses.write(texels.reshape(-1, 4), 0, len(poses) * 4)
        moved = self._time is None or len(scene.actors) > 0
        self._time = time
        if moved:
            self.means, _ = placed(scene.gaussians.means, scene.gaussians.quats, scene.nodes, poses)
            self.look_version += 1
            self.pose_version += 1

    def _index_pairs(self) -> ndarray:
        return np.stack([self._document.scene.nodes, self._document.colors.indices], axis=1)


def sky_texture(ctx: moderngl.Context, sky: Sky | None) -> moderngl.TextureArray | None:
    """The six faces as layers, filtered and clamped as `Sky.colors` does."""
    if sky is None:
        return None
    resolution = sky.faces.shape[1]
    texture = ctx.texture_array((resolution, resolution, 6), 3, sky.faces.astype(np.float32).tobytes(), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture


def _geometry_texels(document: Document) -> ndarray:
    gaussians = document.scene.gaussians
    texels = np.zeros((len(gaussians), 3, 4), np.float32)
    texels[:, 0, :3], texels[:, 0, 3] = gaussians.means, gaussians.opacities
    texels[:, 1] = normalized(gaussians.quats)
    texels[:, 2, :3] = gaussians.scales
    return texels.reshape(-1, 4)


def _harmonics_texture(ctx: moderngl.Context, document: Document) -> tuple[ArrayTexture, int]:
    gaussians = document.scene.gaussians
    values = np.concatenate([gaussians.sh_dc[:, None], gaussians.sh_rest], axis=1).reshape(len(gaussians), -1)
    width = 3 * (1 + gaussians.sh_rest.shape[1])
    texels = -(-width // 4)
    padded = np.zeros((len(gaussians), texels * 4), np.float32)
    padded[:, :width] = values
    return ArrayTexture(ctx, padded.reshape(-1, 4)), texels


def _palette_texels(document: Document) -> ndarray:
    palette = document.colors
    texels = np.zeros((len(palette), 4, 4), np.float32)
    texels[:, :3], texels[:, 3, 0] = palette.matrices, palette.alphas
    return texels.reshape(-1, 4)


def _id_colors(ids: ndarray) -> ndarray:
    """RGBA8; codewords above 24 bits share the colours of their low 24 bits."""
    colors = np.full((len(ids), 4), 255, np.uint8)
    distinct, inverse = np.unique(ids, return_inverse=True)
    colors[:, :3] = colors_from_ids((distinct % ID_LIMIT).astype(np.uint32))[inverse]
    return colors
