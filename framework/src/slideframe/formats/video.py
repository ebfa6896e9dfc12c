"""H.264 films through PyAV."""

from collections.abc import Iterable
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from slideframe.errors import MissingDependency
from slideframe.products import Picture
from slideframe.store import storing


def require_encoder() -> None:
    """Raise MissingDependency unless films can be written."""
    if find_spec("av") is None:
        raise MissingDependency(
            "films need the package 'av' (PyAV)",
            where="film.mp4",
            cure='pip install "slideframe[video]", or run with --no-film',
        )


def write_mp4(pictures: Iterable[Picture], path: Path, frame_rate: float) -> None:
    """Write a film that plays in real time; the file appears when it is whole.

    Raises:
        StoreError: the file can't be written.
    """
    import av

    partial = path.with_name(path.name + ".partial")
    with storing(path):
        # the seconds are exact to a millisecond a frame
        rate = Fraction(frame_rate).limit_denominator(1000)
        with av.open(str(partial), "w", format="mp4", options={"movflags": "faststart"}) as container:
            stream = None
            for picture in pictures:
                if stream is None:
                    stream = container.add_stream("libx264", rate=rate, options={"crf": "18", "threads": "1"})
                    stream.height, stream.width = picture.pixels.shape[:2]
                    stream.pix_fmt = "yuv420p"
                frame = av.VideoFrame.from_ndarray(np.array(picture.pixels), format="rgb24")
                container.mux(stream.encode(frame))
            if stream is not None:
                container.mux(stream.encode())
        partial.rename(path)
