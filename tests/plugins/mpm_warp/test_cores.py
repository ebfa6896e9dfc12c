"""How many cores Warp's kernels are spread over."""

import os

from slideframe_mpm_warp.cores import LEAST_PARTICLES_PER_CORE, Cores, core_count


def test_only_cores_that_the_process_may_use_count(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: {2, 5, 7}, raising=False)
    assert core_count() == 3
    assert Cores(2 * LEAST_PARTICLES_PER_CORE).count == 2


def test_where_the_system_does_not_tell_all_cores_count(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert core_count() == 6
