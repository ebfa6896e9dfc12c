"""The film beside the moving splats."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from slideframe.errors import MissingDependency
from slideframe.formats.video import encode_av1, require_encoder
from slideframe.products import Picture
from slideframe.record.drawing import jpeg


def log_film(stream: rr.RecordingStream, film: Sequence[Picture], frame_rate: float) -> list[str]:
    """Log the pictures over `sim_time` and `frame`, as an AV1 video, which viewers play by themselves.

    Returns:
        What is not as it could be, one phrase each.
    """
    try:
        require_encoder("av1")
    except MissingDependency as absent:
        for index, picture in enumerate(film):
            stream.set_time("sim_time", duration=picture.time)
            stream.set_time("frame", sequence=index)
            stream.log("film", rr.EncodedImage(contents=jpeg(picture.pixels), media_type="image/jpeg"))
        return [f"the film is kept as JPEG pictures, several times larger than a video: {absent.what}"]
    video = rr.AssetVideo(contents=encode_av1((picture.pixels for picture in film), frame_rate), media_type="video/mp4")
    stream.log("film", video, static=True)
    moments = video.read_frame_timestamps_nanos()
    times = np.array([picture.time for picture in film])
    if len(moments) != len(times):
        raise AssertionError(f"the video has {len(moments)} frames of {len(times)} pictures")
    stream.send_columns(
        "film",
        indexes=[rr.TimeColumn("sim_time", duration=times), rr.TimeColumn("frame", sequence=range(len(times)))],
        columns=rr.VideoFrameReference.columns_nanos(moments),
    )
    return []
