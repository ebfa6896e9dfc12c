import subprocess
import sys

import numpy as np
import pytest

from slideframe.record import drawing

FULL_DISK = """
import resource, signal
from pathlib import Path
import numpy as np, rerun as rr
from slideframe import record
from slideframe.errors import StoreError
from slideframe.record import stream

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
# a writer that has died may be waited for, but not for the two minutes that a slow disk is given
stream.FLUSH_SECONDS = 10.0
recording = record.Recording(Path({path!r}), "full")
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
for index in range(20):
    recording.stream.set_time("sim_time", duration=index / 10)
    recording.stream.log("points", rr.Points3D(np.random.default_rng(index).normal(size=(20_000, 3))))
try:
    recording.close()
except StoreError as error:
    print(error)
"""


def test_a_full_disk_under_the_recording_is_an_error_and_no_endless_wait(tmp_path):
    path = tmp_path / "recording.rrd"
    program = FULL_DISK.format(path=str(path))
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=100)
    assert "the recording can't be written" in done.stdout, done.stderr
    assert not path.exists()


def test_thinning_is_even_and_keeps_both_ends():
    assert drawing.thinned(5, 10).tolist() == [0, 1, 2, 3, 4]
    kept = drawing.thinned(1001, 11)
    assert kept.tolist() == list(range(0, 1001, 100))


def test_quaternions_and_colours_are_rerun_s():
    assert drawing.real_part_last(np.float32([[1, 2, 3, 4]])).tolist() == [[2, 3, 4, 1]]
    harmonics = np.zeros((2, 1, 3), np.float32)
    harmonics[1] = 0.5 / drawing.HARMONIC_0
    rgba = drawing.rgba(harmonics, np.float32([0.2, 1]))
    assert rgba.tolist() == [[128, 128, 128, 51], [255, 255, 255, 255]]


@pytest.mark.parametrize(("share", "colour"), [(0.0, [70, 90, 130]), (0.5, [240, 210, 80]), (1.0, [190, 30, 30])])
def test_heat_runs_from_blue_over_yellow_to_red(share, colour):
    assert drawing.heat(np.float32([share])).tolist() == [colour]
