"""Wall seconds and peak memory of one stage."""

import resource
import sys
import time
from pathlib import Path

_STATUS = Path("/proc/self/status")
_CLEAR_REFS = Path("/proc/self/clear_refs")


class Meter:
    """Starts when made; reads the time passed and the peak memory since.

    On Linux the process's high-water mark is reset at the start, so that the peak is this stage's.
    Elsewhere it is the highest of the process so far.
    """

    def __init__(self) -> None:
        """Start measuring."""
        self._start = time.perf_counter()
        try:
            _CLEAR_REFS.write_text("5")
        except OSError:
            self._resettable = False
        else:
            self._resettable = _STATUS.exists()

    def figures(self) -> dict[str, float]:
        """Return `wall_seconds` and `peak_memory_mib`."""
        return {
            "wall_seconds": round(time.perf_counter() - self._start, 3),
            "peak_memory_mib": round(self._peak_kib() / 1024, 1),
        }

    def _peak_kib(self) -> float:
        if self._resettable:
            for line in _STATUS.read_text().splitlines():
                if line.startswith("VmHWM:"):
                    return float(line.split()[1])
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return peak / 1024 if sys.platform == "darwin" else float(peak)
