"""Video files, written frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray

from instdrive_core.errors import DataError
from instdrive_core.extras import explain_missing_module
from instdrive_core.files.atomic import open_atomically

CODECS = {".mp4": ("libx264", {"crf": "18"}), ".webm": ("libvpx-vp9", {"crf": "28", "b": "0"})}
"""Encoder and its options by the ending of the video."""
_BT709, _LIMITED = 1, 1
"""Numbers that H.273 gives the colours of high-definition video and their range from 16 to 235."""
_OTHER_KIND = "Choose the other ending, or frames as PNG"

Frame = UInt8[ndarray, "h w 3"]


def load_av() -> Any:
    """Import PyAV. Raises MissingExtraError where it is not installed."""
    try:
        import av
    except ModuleNotFoundError as error:
        raise explain_missing_module(error) or error from error
    return av


@contextmanager
def open_video(out: Path, width: int, height: int, rate: float) -> Iterator[Callable[[Frame], None]]:
    """Open a video and give what adds a frame to it; the file is there when the block ends without an error.

    Colours are converted and marked as BT.709: players take those of a large video without a mark for that.

    Args:
        out: file that ends in .mp4 or .webm.
        width: pixels, even.
        height: pixels, even.
        rate: frames per second.

    Raises DataError where it cannot be encoded or written, MissingExtraError without PyAV.
    """
    av = load_av()
    codec, options = CODECS[out.suffix.lower()]
    with open_atomically(out) as file:
        try:
            with av.open(file, "w", format=out.suffix.lower()[1:]) as container:
                try:
                    stream = container.add_stream(codec, rate=Fraction(rate).limit_denominator(1001))
                except ValueError as error:  # this build of PyAV lacks the encoder
                    raise DataError(out, f"the video cannot be encoded ({error})", _OTHER_KIND) from error
                stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
                stream.options = options
                coder = stream.codec_context
                coder.colorspace, coder.color_primaries, coder.color_trc, coder.color_range = (*[_BT709] * 3, _LIMITED)

                def add(frame: Frame) -> None:
                    picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
                    picture = picture.reformat(format="yuv420p", dst_colorspace=_BT709, dst_color_range=_LIMITED)
                    container.mux(stream.encode(picture))

                yield add
                container.mux(stream.encode())
        except av.error.FFmpegError as error:
            raise DataError(out, f"the video cannot be encoded ({error})", _OTHER_KIND) from error
