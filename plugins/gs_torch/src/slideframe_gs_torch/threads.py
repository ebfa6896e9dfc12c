"""How many threads a computation is worth. Results are the same bits for any number."""

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import torch

# Below this many pixels and splats, threads wait for each other longer than they work.
WORTH_THREADS = 60_000


@contextmanager
def threads_for(work: int) -> Iterator[None]:
    """Give the compiled kernels all threads, or one where the work (pixels + splats) is small."""
    before = numba.get_num_threads()
    numba.set_num_threads(before if work >= WORTH_THREADS else 1)
    try:
        yield
    finally:
        numba.set_num_threads(before)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Keep torch's own threads out of the way: its part is many small operations, each of which would wait."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
