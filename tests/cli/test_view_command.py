"""calibtool view: a page from either kind of file; the live view ends on Ctrl-C."""

import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from commandline import ENVIRONMENT, Files, refused, run


@pytest.mark.parametrize("kind", ["measurements", "network"])
def test_a_page_of_either_kind_of_file(files: Files, kind: str) -> None:
    path = getattr(files, kind)
    run("view", path, "--html", "v.html")
    assert "planar-3r" in Path("v.html").read_text()
    with open(path, "rb") as stream:
        assert (
            run("view", "-", "--html", "-", "--magnify", 7, stdin=stream.read()).stdout.count(
                'value="7"'
            )
            == 1
        )


def test_wrong_usage(files: Files) -> None:
    Path("v.html").write_text("mine")
    assert "exists already" in refused(2, "view", files.measurements, "--html", "v.html")
    assert "--magnify" in refused(2, "view", files.measurements, "--magnify", "nan")
    assert "--meshes" in refused(2, "view", files.measurements, "--meshes", "nowhere")
    run("view", files.measurements, "--meshes", ".", "--html", "w.html")
    assert "no such file" in refused(2, "view", "none.h5")
    assert "not an HDF5 file" in refused(3, "view", "v.html")


def test_the_live_view_ends_on_ctrl_c(files: Files) -> None:
    pytest.importorskip("viser")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "calibtool", "view", files.measurements, "--port", str(port)]
    with subprocess.Popen(
        command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stderr is not None
        line = process.stderr.readline().decode()
        os.kill(process.pid, signal.SIGINT)
        out, rest = process.communicate(timeout=60)
    assert f"http://127.0.0.1:{port}" in line
    assert (process.returncode, out, rest) == (0, b"", b"")
