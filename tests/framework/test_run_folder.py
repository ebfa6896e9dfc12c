import logging
from pathlib import Path

import pytest

from slideframe.run_folder import JsonLines


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_does_not_make_the_log_hide_the_error_it_should_tell():
    handler = JsonLines(Path("/dev/full"))
    record = logging.LogRecord("slideframe", logging.ERROR, __file__, 1, "no space", None, None)
    handler.emit(record)
    handler.close()


def test_tracebacks_are_kept(tmp_path):
    handler = JsonLines(tmp_path / "log.jsonl")
    try:
        raise ZeroDivisionError("planted")
    except ZeroDivisionError as error:
        trace = (type(error), error, error.__traceback__)
    handler.emit(logging.LogRecord("slideframe", logging.ERROR, __file__, 1, "failed", None, trace))
    handler.close()
    assert "planted" in (tmp_path / "log.jsonl").read_text()
