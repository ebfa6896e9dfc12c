"""One .rrd file being written."""

from pathlib import Path

import rerun as rr

from slideframe.errors import StoreError
from slideframe.record.blueprint import Eye, blueprint

APPLICATION = "slideframe"
# far more than a recording takes on a slow disk
FLUSH_SECONDS = 120.0


class Recording:
    """One .rrd file being written; it appears under its name when closed."""

    def __init__(self, path: Path, name: str, eye: Eye | None = None, *, active_tab: int = 0) -> None:
        """Open the file beside its final place, blueprint first; `eye` is where the 3-D views look from."""
        self._path = path
        self._partial = path.with_name(path.name + ".partial")
        self.stream = rr.RecordingStream(APPLICATION, recording_id=name)
        self.stream.save(self._partial, default_blueprint=blueprint(eye, active_tab))
        self.stream.send_recording_name(name)
        self.stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    @property
    def written_bytes(self) -> int:
        """What the file holds by now."""
        self._flush()
        return self._partial.stat().st_size

    def close(self) -> None:
        """Finish the file and give it its name."""
        self._flush()
        self.stream.disconnect()
        self._partial.rename(self._path)

    def _flush(self) -> None:
        try:
            self.stream.flush(timeout_sec=FLUSH_SECONDS)
        except Exception as error:  # rerun's own classes; a full disk stops its writer without a word
            raise StoreError(
                f"the recording can't be written: {error}",
                where=str(self._partial),
                cure="free some space; the same command goes on from here",
            ) from error
