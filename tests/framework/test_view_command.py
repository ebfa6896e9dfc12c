"""`slideframe view` starts the viewer on the right file, and says when there is none."""

import socket
import subprocess
import sys
from contextlib import suppress

import pytest

from slideframe.cli import main
from slideframe.run_folder import RECORDING


@pytest.fixture
def started(monkeypatch) -> list[list[str]]:
    calls: list[list[str]] = []
    monkeypatch.setattr(subprocess, "call", lambda command, env: calls.append(command) or 0)
    monkeypatch.setenv("DISPLAY", ":0")
    return calls


def two_free_ports() -> int:
    """Return a port that is free like the one after it."""
    for _ in range(100):
        with socket.socket() as first, socket.socket() as second:
            first.bind(("127.0.0.1", 0))
            port = first.getsockname()[1]
            with suppress(OSError, OverflowError):
                second.bind(("127.0.0.1", port + 1))
                return port
    pytest.fail("no two ports are free")


def test_a_run_s_recording_is_opened_or_served_to_this_machine_alone(tmp_path, started, capsys):
    (tmp_path / RECORDING).touch()
    port = two_free_ports()
    assert main(["view", str(tmp_path)]) == 0
    assert main(["view", str(tmp_path / RECORDING), "--web", "--port", str(port)]) == 0
    here = ["-m", "rerun", str(tmp_path / RECORDING), "--bind", "127.0.0.1"]
    assert started[0][1:] == here
    assert started[1][1:] == [*here, "--serve-web", "--web-viewer-port", str(port), "--port", str(port + 1)]
    link = f"http://127.0.0.1:{port}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port + 1}%2Fproxy"
    assert f"open {link}\n" in capsys.readouterr().out


def test_others_are_given_this_machine_s_name(tmp_path, started, capsys):
    (tmp_path / RECORDING).touch()
    port = two_free_ports()
    assert main(["view", str(tmp_path), "--web", "--port", str(port), "--address", "0.0.0.0"]) == 0
    assert f"open http://{socket.gethostname()}:{port}/" in capsys.readouterr().out


@pytest.mark.parametrize("taken", [0, 1])
def test_a_port_that_is_taken_is_said(tmp_path, started, capsys, taken):
    (tmp_path / RECORDING).touch()
    port = two_free_ports()
    with socket.socket() as other:
        other.bind(("127.0.0.1", port + taken))
        other.listen()
        assert main(["view", str(tmp_path), "--web", "--port", str(port)]) == 2
    assert f"nothing can be served at port {port + taken}" in capsys.readouterr().err
    assert not started


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a screen")
def test_a_machine_without_a_screen_is_told_of_the_browser(tmp_path, started, monkeypatch, capsys):
    (tmp_path / RECORDING).touch()
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    assert main(["view", str(tmp_path)]) == 3
    assert "--web" in capsys.readouterr().err
    assert not started


def test_a_folder_without_a_recording_is_said(tmp_path, started, capsys):
    assert main(["view", str(tmp_path)]) == 2
    assert "there is no recording" in capsys.readouterr().err
    assert not started


def test_ctrl_c_ends_the_serving(tmp_path, monkeypatch):
    (tmp_path / RECORDING).touch()

    def interrupted(command, env):
        raise KeyboardInterrupt

    monkeypatch.setattr(subprocess, "call", interrupted)
    assert main(["view", str(tmp_path), "--web", "--port", str(two_free_ports())]) == 0
