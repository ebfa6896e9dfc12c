"""One .rrd file being written."""

import ctypes
import os
import shutil
import time
from contextlib import suppress
from pathlib import Path

import rerun as rr

from slideframe.errors import StoreError
from slideframe.record.blueprint import Eye, blueprint

APPLICATION = "slideframe"
# A file that hasn't grown for this long, while more waits to be written, won't; and how often to look.
STALL_SECONDS, LOOK_SECONDS = 15.0, 1.0
# rerun's word for a writer that isn't ready yet, or is dead without knowing it
TIMED_OUT = "timed out"
# a file's last bytes but its version's; the writer says nothing where there is no room for them
FOOTER, FOOTER_VERSION_BYTES = b"RRF2FOOT", 4


class Recording:
    """One .rrd file being written; it appears under its name when closed."""

    def __init__(
        self,
        path: Path,
        name: str,
        eye: Eye | None = None,
        *,
        active_tab: int = 0,
        compared: bool = False,
        stressed: bool = False,
        pictured: bool = False,
    ) -> None:
        """Open the file beside its final place, blueprint first.

        Args:
            path: of the file.
            name: of the recording.
            eye: where the 3-D views look from.
            active_tab: the one that is open at first.
            compared: whether there is a map of the surface's difference to a reference ground.
            stressed: whether particles carry stress and plastic strain.
            pictured: whether there are pictures of how the scan came about.
        """
        self._path = path
        self._partial = path.with_name(path.name + ".partial")
        self.stream = rr.RecordingStream(APPLICATION, recording_id=name)
        self.stream.save(self._partial, default_blueprint=blueprint(eye, active_tab, compared, stressed, pictured))
        self.stream.send_recording_name(name)
        self.stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def flush(self) -> int:
        """Wait until all that was logged is in the file, and return the file's length, bytes.

        Call it often: until then rerun holds what was logged in memory, and says nothing of a full disk.

        Raises:
            StoreError: the file can't be written; nothing of it stays.
        """
        length, grown = 0, time.monotonic()
        while True:
            try:
                self.stream.flush(timeout_sec=LOOK_SECONDS)
                return self._partial.stat().st_size
            except (RuntimeError, OSError) as error:
                before, length = length, self._partial.stat().st_size
                grown = time.monotonic() if length > before else grown
                if TIMED_OUT not in str(error) or time.monotonic() - grown > STALL_SECONDS:
                    raise self._abandoned(str(error)) from error

    def close(self) -> None:
        """Finish the file and give it its name.

        Raises:
            StoreError: the file can't be written; nothing of it stays.
        """
        self.flush()
        self.stream.disconnect()
        with self._partial.open("rb") as file:
            file.seek(-len(FOOTER) - FOOTER_VERSION_BYTES, os.SEEK_END)
            if not file.read().startswith(FOOTER):
                raise self._abandoned("its index is not whole")
        self._partial.rename(self._path)

    def _abandoned(self, reason: str) -> StoreError:
        """Never ask rerun for this stream again, not even when the process ends, and return the error to raise.

        A full disk ends rerun's writer, and some of those who wait for it then wait for ever (rerun 0.41): at exit
        its shutdown does, and so would the stream's destructor. So neither is left to run.
        """
        rr.unregister_shutdown()
        ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.stream))
        free = shutil.disk_usage(self._path.parent).free / 1e6
        with suppress(OSError):
            self._partial.unlink(missing_ok=True)
        return StoreError(
            f"the recording can't be written, {free:,.0f} MB of the disk are free: {reason}",
            where=str(self._path),
            cure="free some space; the same command goes on from here",
        )
