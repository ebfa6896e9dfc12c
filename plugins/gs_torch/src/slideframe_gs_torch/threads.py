"""Compiled kernels on several threads, without spinning.

Numba's own parallel loops wait for one another by spinning, which on a busy machine costs many times the
work itself. Kernels that release the interpreter's lock and take a range of tasks need no more than a pool
of Python threads, which sleep while they wait. Tasks share no sums, so results are the same bits for any
number of threads.
"""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

import numba
import torch

# Below this many pixels or splats, handing tasks out takes longer than doing them.
WORTH_THREADS = 20_000
# Tasks differ in cost, so each thread fetches several shares.
SHARES_PER_THREAD = 8


def thread_count() -> int:
    """Return how many threads may compute; NUMBA_NUM_THREADS limits it."""
    return int(numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]  # set while Numba starts


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="splats")


def run_shares(kernel: Callable[..., None], tasks: int, work: int, *arguments: object) -> None:
    """Call kernel(first, last, *arguments) on shares of range(tasks); `work` is the number of pixels or splats.

    This thread works too; shares are fetched one by one from an iterator, which the interpreter's lock guards.
    """
    threads = thread_count()
    if threads == 1 or work < WORTH_THREADS:
        kernel(0, tasks, *arguments)
        return
    share = max(1, -(-tasks // (threads * SHARES_PER_THREAD)))
    firsts = iter(range(0, tasks, share))

    def fetch_and_work() -> None:
        for first in firsts:
            kernel(first, min(first + share, tasks), *arguments)

    helpers = [_pool(threads - 1).submit(fetch_and_work) for _ in range(threads - 1)]
    fetch_and_work()
    for helper in helpers:
        if not helper.cancel():  # one that a busy machine hasn't let start is not waited for
            helper.result()


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Keep torch's own threads out of the way: its part is many small operations, each of which would wait."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
