"""A document's arrays on the GPU, kept up to date by uploading only what changed."""

from __future__ import annotations

import moderngl
import numpy as np
from jaxtyping import Float32
from numpy import ndarray

from instdrive_app.render.gl.programs import set_uniforms
from instdrive_app.render.gl.splat_textures import WIDTH, ArrayTexture
from instdrive_app.render.splat_blocks import SplatPlaces, list_move_scales
from instdrive_app.render.world_means import WorldMeans
from instdrive_core.edits.document.document import Document
from instdrive_core.edits.document.versions import DocumentVersions
from instdrive_core.maths.rotations import normalize_quaternions
from instdrive_core.rasterize.kernels.layout import to_kernel_array
from instdrive_core.scene.camera import PhotoLag
from instdrive_core.scene.gaussians import Gaussians
from instdrive_core.scene.palette import ColorPalette
from instdrive_core.scene.scene import extract_node_rotations
from instdrive_core.scene.selection import Flag
from instdrive_core.scene.sky import Sky
from instdrive_core.scene.transforms import TransformPalette

NOT_DRAWN = int(Flag.HIDDEN | Flag.DELETED)
UPLOADED_AT_ONCE = 1 << 16
"""Splats whose stored parameters go to the GPU in one step, about 16 MB."""


class GpuScene:
    """The textures of one document; `update` brings them to its present state at a given time."""

    def __init__(self, ctx: moderngl.Context, document: Document) -> None:
        self._document = document
        gaussians = document.scene.gaussians
        self._harmonic_texels = -(-3 * (1 + gaussians.sh_rest.shape[1]) // 4)
        self._geometry = ArrayTexture(ctx, 4, "f4", texels=3)
        self._harmonics = ArrayTexture(ctx, 4, "f4", texels=self._harmonic_texels)
        self._nodes, self._color_entries, self._transform_entries = (ArrayTexture(ctx, 1, "u2") for _ in range(3))
        self.states = ArrayTexture(ctx, 1, "u1")
        self.instance_ids = ArrayTexture(ctx, 1, "u4")
        self.codewords = ArrayTexture(ctx, 1, "u4")
        self._poses, self._colors, self._transforms = (ArrayTexture(ctx, 4, "f4", texels=4) for _ in range(3))
        self._ctx, self._shown_sky = ctx, document.scene.sky
        self.sky = upload_sky(ctx, document.scene.sky)
        self._world = WorldMeans(document)
        self._new_rows = document.new_rows.create_reader()
        self._uploaded = 0
        self._log_scales = np.zeros((0, 3), np.float32)
        self._dirty_states = document.state.create_dirty_reader()
        self._dirty_colors = document.colors.create_dirty_reader()
        self._dirty_transforms = document.transforms.create_dirty_reader()
        self._hidden, self._ids = np.zeros(0, np.uint8), np.zeros(0, np.uint32)
        self._versions: DocumentVersions | None = None
        self._pose_texels = np.zeros((0, 4, 4), np.float32)
        self.look_version = 0
        """Rises when the blended picture would change: visibility, colours, places."""
        self.pose_version = 0
        """Rises when splats move, are added or taken away."""
        self.id_version = 0
        """Rises when splats change instances."""

    def __len__(self) -> int:
        return len(self._document.scene)

    @property
    def antialiased(self) -> bool:
        """Whether the scene was trained with the antialiased filter, see `Scene.antialiased`."""
        return self._document.scene.antialiased

    @property
    def means(self) -> Float32[ndarray, "n 3"]:
        """World positions (metres) at the time of the last update."""
        return self._world.values

    @property
    def places(self) -> SplatPlaces:
        """Where the splats are and how far they reach, for whoever leaves out what is not in view."""
        document, scene = self._document, self._document.scene
        scales = list_move_scales(document.transforms.matrices)
        return SplatPlaces(
            self.means, self._log_scales, document.transforms.indices, scales, scene.nodes, scene.instance_ids
        )

    @property
    def complete(self) -> bool:
        """Whether all splats are on the GPU; those that are not yet there are not drawn."""
        return self._uploaded == len(self)

    def update(self, time: float, lag: PhotoLag | None = None, wait: bool = True) -> None:
        """Upload what has changed since the last call, and the actors' poses at `time` (seconds), as a photo with this
        `lag` shows them.

        Without `wait`, one call uploads the stored parameters of only so many new splats; see `complete`.
        """
        document = self._document
        before, now = self._versions, document.versions
        self._versions = now
        rows_changed = before is None or now.rows != before.rows
        if rows_changed:
            self._make_room()
        self._upload_parameters(wait)
        if before is None or rows_changed or now.states != before.states:
            self._update_states()
        if before is None or rows_changed or now.colors != before.colors:
            self._update_colors()
        if before is None or rows_changed or now.transforms != before.transforms:
            self._update_transforms()
        if before is None or rows_changed or now.table != before.table:
            self._update_ids()
        self._update_places(time, lag)
        self._update_sky()

    def bind(self, program: moderngl.Program) -> None:
        """Bind the textures that projection reads, to units 0 to 8."""
        named = {
            "geometry_texture": self._geometry,
            "sh_texture": self._harmonics,
            "node_texture": self._nodes,
            "color_entry_texture": self._color_entries,
            "transform_entry_texture": self._transform_entries,
            "state_texture": self.states,
            "pose_texture": self._poses,
            "color_texture": self._colors,
            "transform_texture": self._transforms,
        }
        for unit, (name, array) in enumerate(named.items()):
            array.texture.use(unit)
            set_uniforms(program, **{name: unit})
        set_uniforms(
            program,
            row_count=self._uploaded,
            texture_width=WIDTH,
            sh_texels=self._harmonic_texels,
            sh_rest_count=self._document.scene.gaussians.sh_rest.shape[1],
            hidden_flags=NOT_DRAWN,
        )

    def release(self) -> None:
        """Free all textures."""
        for array in (
            *(self._geometry, self._harmonics, self.instance_ids, self.codewords, self.states),
            *(self._nodes, self._color_entries, self._transform_entries),
            *(self._poses, self._colors, self._transforms),
        ):
            array.release()
        if self.sky is not None:
            self.sky.release()

    def _make_room(self) -> None:
        count = len(self)
        for array in (self._geometry, self._harmonics, self._nodes, self._color_entries, self._transform_entries):
            array.reserve(count)
        for array in (self.states, self.instance_ids, self.codewords):
            array.reserve(count)
        self._log_scales = to_kernel_array(self._document.scene.gaussians.log_scales)
        fresh = self._new_rows.take()
        self._uploaded = min(self._uploaded, count if fresh is None else fresh[0])
        self.look_version += 1
        self.pose_version += 1
        self.id_version += 1

    def _upload_parameters(self, wait: bool) -> None:
        """Upload the parameters that edits never write to; the other updates bring the rest."""
        scene, count = self._document.scene, len(self)
        while self._uploaded < count:
            start = self._uploaded
            rows = slice(start, min(start + UPLOADED_AT_ONCE, count))
            gaussians = scene.gaussians.select(rows)
            self._geometry.write(_pack_geometry(gaussians), start)
            self._harmonics.write(_pack_harmonics(gaussians, self._harmonic_texels), start)
            self._nodes.write(scene.nodes[rows], start)
            self.codewords.write(scene.codewords[rows], start)
            self._uploaded = rows.stop
            self.look_version += 1
            if not wait:
                break

    def _update_states(self) -> None:
        flags, dirty = self._document.state.flags, self._dirty_states.take()
        hidden = _resize(self._hidden, len(flags))
        if dirty is not None:
            rows = slice(*dirty)
            self.states.write(flags[rows], dirty[0])
            now = flags[rows] & NOT_DRAWN
            if not np.array_equal(now, hidden[rows]):
                hidden[rows] = now
                self.look_version += 1
        self._hidden = hidden

    def _update_colors(self) -> None:
        palette, dirty = self._document.colors, self._dirty_colors.take()
        if dirty is not None:
            self._color_entries.write(palette.indices[slice(*dirty)], dirty[0])
        self._colors.reserve(len(palette))
        self._colors.write(_pack_colors(palette), 0)
        self.look_version += 1

    def _update_transforms(self) -> None:
        palette, dirty = self._document.transforms, self._dirty_transforms.take()
        if dirty is not None:
            self._transform_entries.write(palette.indices[slice(*dirty)], dirty[0])
        self._transforms.reserve(len(palette))
        self._transforms.write(_pack_transforms(palette), 0)

    def _update_ids(self) -> None:
        ids = self._document.scene.instance_ids
        known = _resize(self._ids, len(ids))
        known[len(self._ids) :] = ~ids[len(self._ids) :]  # new rows count as changed
        changed = np.flatnonzero(ids != known)
        self._ids = known
        if len(changed):
            rows = slice(int(changed[0]), int(changed[-1]) + 1)
            known[rows] = ids[rows]
            self.instance_ids.write(ids[rows], rows.start)
            self.id_version += 1

    def _update_sky(self) -> None:
        """Upload the sky again after the whole scene was turned."""
        if self._document.scene.sky is not self._shown_sky:
            self._shown_sky = self._document.scene.sky
            if self.sky is not None:
                self.sky.release()
            self.sky = upload_sky(self._ctx, self._shown_sky)
            self.look_version += 1

    def _update_places(self, time: float, lag: PhotoLag | None) -> None:
        moved = self._world.update(time, lag)
        texels = _pack_poses(self._world)
        if not np.array_equal(texels, self._pose_texels):
            self._poses.reserve(len(texels))
            self._poses.write(texels, 0)
            self._pose_texels = texels
            self.look_version += 1
        if moved is not None:
            self.look_version += 1
            self.pose_version += 1


def upload_sky(ctx: moderngl.Context, sky: Sky | None) -> moderngl.TextureArray | None:
    """Upload the six faces as layers, filtered and clamped as in `Sky.colors`; None if there is no sky."""
    if sky is None:
        return None
    resolution = sky.faces.shape[1]
    texture = ctx.texture_array((resolution, resolution, 6), 3, sky.faces.astype(np.float32).tobytes(), dtype="f4")
    texture.filter = (moderngl.LINEAR, moderngl.LINEAR)
    texture.repeat_x = texture.repeat_y = False
    return texture


def _pack_geometry(gaussians: Gaussians) -> Float32[ndarray, "n 3 4"]:
    texels = np.zeros((len(gaussians), 3, 4), np.float32)
    texels[:, 0, :3], texels[:, 0, 3] = gaussians.means, gaussians.opacities
    texels[:, 1] = normalize_quaternions(gaussians.quats)
    texels[:, 2, :3] = gaussians.scales
    return texels


def _pack_harmonics(gaussians: Gaussians, texels: int) -> Float32[ndarray, "n {texels} 4"]:
    count, width = len(gaussians), 3 * (1 + gaussians.sh_rest.shape[1])
    padded = np.zeros((count, texels * 4), np.float32)
    padded[:, :3] = gaussians.sh_dc
    padded[:, 3:width] = gaussians.sh_rest.reshape(count, -1)
    return padded.reshape(count, texels, 4)


def _pack_colors(palette: ColorPalette) -> Float32[ndarray, "p 4 4"]:
    texels = np.zeros((len(palette), 4, 4), np.float32)
    texels[:, :3], texels[:, 3, 0] = palette.matrices, palette.alphas
    return texels


def _pack_transforms(palette: TransformPalette) -> Float32[ndarray, "p 4 4"]:
    """Pack each move as the rows of [R | t], then the scale s."""
    matrices = palette.matrices
    scales = np.linalg.norm(matrices[:, :, 0], axis=1)
    texels = np.zeros((len(palette), 4, 4), np.float32)
    texels[:, :3, :3] = matrices[:, :, :3] / scales[:, None, None]
    texels[:, :3, 3] = matrices[:, :, 3]
    texels[:, 3, 0] = scales
    return texels


def _pack_poses(world: WorldMeans) -> Float32[ndarray, "m 4 4"]:
    texels = np.zeros((len(world.poses), 4, 4), np.float32)
    texels[:, :3, :3] = extract_node_rotations(world.poses)
    texels[:, :3, 3] = world.poses[:, :3, 3]
    texels[:, 3, 0] = world.present
    return texels


def _resize(array: ndarray, count: int) -> ndarray:
    """Cut an array to `count` rows, or pad it with zeros."""
    if count <= len(array):
        return array[:count]
    return np.concatenate([array, np.zeros(count - len(array), array.dtype)])
