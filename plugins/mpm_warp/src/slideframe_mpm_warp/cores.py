"""All cores of a processor for Warp, which runs a kernel on one but lets go of Python's lock meanwhile."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

# A thread costs some twenty microseconds to wake, the work of some hundred particles.
LEAST_PARTICLES_PER_CORE = 2_000


def core_count() -> int:
    """Return how many cores this process may use, where the system tells; else how many there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Cores:
    """Runs the parts of a kernel at the same time, one on each core, and waits for all."""

    def __init__(self, particle_count: int) -> None:
        """Keep a thread ready for each core that has enough to do."""
        self.count = max(1, min(core_count(), particle_count // LEAST_PARTICLES_PER_CORE))
        self._pool = ThreadPoolExecutor(self.count, thread_name_prefix="mpm_warp")

    def run(self, parts: Sequence[Any]) -> None:
        """Launch the recorded parts; no two may write to the same memory."""
        waiting = [self._pool.submit(part.launch) for part in parts[1:]]
        parts[0].launch()
        for part in waiting:
            part.result()
