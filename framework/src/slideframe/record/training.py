"""Pictures of how a reconstruction came about."""

from pathlib import Path

import rerun as rr

# s, before anything moves
AT_REST = 0.0


def log_training(stream: rr.RecordingStream, pictures: Path) -> None:
    """Log the pictures `<name>/<iteration>.jpg` of a folder, if there is one, on the timeline `iteration`.

    On the motion's timeline all of them lie at its beginning, where the viewer shows the last.
    """
    for path in sorted(pictures.glob("*/*.jpg"), key=lambda file: file.stem):
        stream.set_time("iteration", sequence=int(path.stem))
        stream.set_time("sim_time", duration=AT_REST)
        picture = rr.EncodedImage(contents=path.read_bytes(), media_type="image/jpeg")
        stream.log(["training", path.parent.name], picture)  # as a list, for names may hold what a path can't
    stream.reset_time()
