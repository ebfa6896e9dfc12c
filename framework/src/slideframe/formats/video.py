"""Films through PyAV: H.264 to be shared, AV1 for the recording, whose viewer plays it by itself."""

import io
import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any, Literal

import numpy as np

from slideframe.arrays import UInt8Array
from slideframe.errors import MissingDependency
from slideframe.store import storing

Codec = Literal["h264", "av1"]
# The same pictures give the same bytes: one thread, and x264 must not choose its routines by where memory lies.
ENCODERS: dict[Codec, tuple[str, dict[str, str]]] = {
    "h264": ("libx264", {"crf": "18", "preset": "faster", "threads": "1", "x264-params": "cpu-independent=1"}),
    "av1": ("libsvtav1", {"crf": "26", "preset": "9", "svtav1-params": "lp=1"}),
}


def require_encoder(*codecs: Codec) -> None:
    """Raise MissingDependency unless films of those kinds can be written.

    Raises:
        MissingDependency: PyAV is absent, or was built without an encoder.
    """
    if find_spec("av") is None:
        raise MissingDependency(
            "films need the package 'av' (PyAV)",
            where="film.mp4",
            cure='pip install "slideframe[video]", or run with --no-film',
        )
    import av

    for codec in codecs:
        name, _ = ENCODERS[codec]
        if name not in av.codecs_available:
            raise MissingDependency(
                f"this PyAV ({av.__version__}) was built without the encoder '{name}'",
                where="film.mp4",
                cure="install PyAV's wheel from PyPI, which has it, or run with --no-film",
            )


def write_mp4(pictures: Iterable[UInt8Array], path: Path, frame_rate: float, codec: Codec = "h264") -> None:
    """Write pictures (height, width, 3) of one even size as a film that plays in real time.

    The file appears when it is whole; of one that can't be written nothing stays.

    Raises:
        MissingDependency: there is no encoder.
        StoreError: the file can't be written.
    """
    require_encoder(codec)
    partial = path.with_name(path.name + ".partial")
    try:
        with storing(path):
            _encode(pictures, str(partial), frame_rate, codec)
            partial.rename(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def encode_av1(pictures: Iterable[UInt8Array], frame_rate: float) -> bytes:
    """Return the pictures as an AV1 film in an mp4 file."""
    file = io.BytesIO()
    _encode(pictures, file, frame_rate, "av1")
    return file.getvalue()


def _encode(pictures: Iterable[UInt8Array], file: str | IO[bytes], frame_rate: float, codec: Codec) -> None:
    os.environ.setdefault("SVT_LOG", "1")  # else the encoder tells the terminal all about itself
    import av

    encoder, settings = ENCODERS[codec]
    # the seconds are exact to a millisecond a frame
    rate = Fraction(frame_rate).limit_denominator(1000)
    # the index goes to the front of a file, so that it plays while it loads
    options = {"movflags": "faststart"} if isinstance(file, str) else {}
    with av.open(file, "w", format="mp4", options=options) as container:
        stream: Any = None
        for pixels in pictures:
            if stream is None:
                stream = container.add_stream(encoder, rate=rate, options=settings)
                stream.height, stream.width = pixels.shape[:2]
                stream.pix_fmt = "yuv420p"
            frame = av.VideoFrame.from_ndarray(pixels.copy(), format="rgb24")
            container.mux(stream.encode(frame))
        if stream is not None:
            container.mux(stream.encode())


def read_frames(path: Path) -> Iterator[UInt8Array]:
    """Give the pictures (height, width, 3) of a film one by one."""
    import av

    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
