"""Growing textures against plain arrays."""

import numpy as np
import pytest

from instdrive_app.render.gl.gl_state import GraphicsError
from instdrive_app.render.gl.splat_textures import WIDTH, ArrayTexture

KINDS = [(4, "f4", 3), (1, "u2", 1), (1, "u1", 1), (1, "u4", 1), (4, "f4", 12)]
NUMPY = {"f4": np.float32, "u1": np.uint8, "u2": np.uint16, "u4": np.uint32}


def contents(array, kind):
    channels, dtype, _ = kind
    return np.frombuffer(array.texture.read(alignment=1), NUMPY[dtype]).reshape(-1, channels)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: "×".join(map(str, kind)))
def test_what_is_written_in_pieces_and_grown_over_is_what_is_there(gl, kind):
    channels, dtype, texels = kind
    rng, array = np.random.default_rng(1), ArrayTexture(gl, channels, dtype, texels)
    expected = np.zeros((0, texels * channels), NUMPY[dtype])
    for count in (10, 5000, 5003, 21000, 9000, 30000):
        grown = rng.integers(0, 200, (max(count - len(expected), 0), texels * channels)).astype(NUMPY[dtype])
        array.reserve(count)
        array.write(grown, len(expected))
        expected = np.concatenate([expected[:count], grown])
        start = int(rng.integers(0, count))
        piece = rng.integers(0, 200, (int(rng.integers(0, count - start + 1)), texels * channels)).astype(NUMPY[dtype])
        array.write(piece, start)
        expected[start : start + len(piece)] = piece
        np.testing.assert_array_equal(contents(array, kind)[: count * texels], expected.reshape(-1, channels))
    array.release()
    assert gl.error == "GL_NO_ERROR"


def test_a_texture_stays_the_same_while_there_is_room(gl):
    array = ArrayTexture(gl, 1, "u2")
    array.reserve(100 * WIDTH)
    first = array.texture
    array.reserve(100 * WIDTH)
    array.reserve(7)
    assert array.texture is first
    array.reserve(100 * WIDTH + 1)
    grown = array.texture
    assert grown is not first
    array.reserve(110 * WIDTH)
    assert array.texture is grown, "what has grown once has room to grow"
    array.release()


def test_more_than_the_driver_can_hold_is_refused_with_the_number(gl):
    array, limit = ArrayTexture(gl, 1, "u1"), gl.info["GL_MAX_TEXTURE_SIZE"]
    array.reserve(50)
    with pytest.raises(GraphicsError, match=rf"{limit * WIDTH + 1:,} splats .* {limit}"):
        array.reserve(limit * WIDTH + 1)
    array.write(np.arange(50, dtype=np.uint8), 0)
    np.testing.assert_array_equal(contents(array, KINDS[2])[:50, 0], np.arange(50))
    array.release()
