import logging
from pathlib import Path

import pytest

from slideframe.run_folder import JsonLines, result_table


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


def test_the_result_page_rounds_numbers_within_tables_too():
    figures = {"by_second": {"32.2": 26.47396835, "39.5": 27.8712371}, "splats": 5, "warnings": ["thin"]}
    page = result_table({"reconstructor": figures}, ["2 of 9 frames of the motion are drawn"])
    assert "| by_second | 32.2: 26.474, 39.5: 27.8712 |\n| splats | 5 |" in page
    assert "> thin" in page
    assert page.endswith("2 of 9 frames of the motion are drawn; the store holds all.")
