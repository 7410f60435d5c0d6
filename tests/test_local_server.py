"""The live view answers the browsers of its machine alone, is not shared, and leaves nothing."""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from calibtool.evaluation.view.local_server import local_server, refusal

OURS = "http://127.0.0.1:8080"


@pytest.mark.parametrize(
    ("hosts", "origins", "upgrade", "why"),
    [
        (["127.0.0.1:8080"], [OURS], True, ""),
        (["localhost:8080"], ["http://localhost:8080"], True, ""),
        (["127.0.0.1:8080"], [], False, ""),  # a page asked for by hand
        (["127.0.0.1:8080"], [], True, "Origin"),
        (["127.0.0.1:8080"], ["https://evil.example"], True, "Origin"),
        (["127.0.0.1:8080"], ["https://evil.example"], False, "Origin"),
        (["127.0.0.1:8080"], ["http://127.0.0.1:8081"], True, "Origin"),
        (["127.0.0.1:8080"], ["https://127.0.0.1:8080"], True, "Origin"),
        (["127.0.0.1:8080"], ["null"], True, "Origin"),
        (["127.0.0.1:8080"], [OURS, "https://evil.example"], True, "Origin"),
        (["evil.example:8080"], ["http://evil.example:8080"], True, "Host"),
        (["evil.example"], [], False, "Host"),
        (["127.0.0.1"], [], False, "Host"),
        (["127.0.0.1:8080.evil.example"], [], False, "Host"),
        (["127.0.0.1:8080", "evil.example"], [OURS], True, "Host"),
        ([], [], False, "Host"),
    ],
)
def test_who_is_answered(hosts: list[str], origins: list[str], upgrade: bool, why: str) -> None:
    assert refusal("127.0.0.1", 8080, hosts, origins, upgrade) == why


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    pytest.importorskip("viser")
    number = free_port()
    server = local_server("127.0.0.1", number, "test")
    assert server.request_share_url() is None
    assert server._share_tunnel is None
    yield number
    server.stop()


def status(port: int, host: str, *headers: str) -> int:
    lines = ["GET / HTTP/1.1", f"Host: {host}", *headers, "", ""]
    with socket.create_connection(("127.0.0.1", port), timeout=20) as connection:
        connection.sendall("\r\n".join(lines).encode())
        return int(connection.recv(100).split()[1])


UPGRADE = (
    "Connection: Upgrade",
    "Upgrade: websocket",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
)


def test_pages(port: int) -> None:
    assert status(port, f"127.0.0.1:{port}") == 200
    assert status(port, f"localhost:{port}") == 200
    assert status(port, "evil.example") == 403
    assert status(port, f"127.0.0.1:{port}", "Origin: http://evil.example") == 403


def test_connections(port: int) -> None:
    own = f"127.0.0.1:{port}"
    assert status(port, own, *UPGRADE, "Origin: http://evil.example") == 403
    assert status(port, own, *UPGRADE) == 403
    assert status(port, f"evil.example:{port}", *UPGRADE, f"Origin: http://{own}") == 403
    assert status(port, own, *UPGRADE, f"Origin: http://{own}") == 101


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_no_process_is_left(number: int, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    program = [sys.executable, "-m", "calibtool"]
    file = tmp_path / "m.h5"
    made = [*program, "simulate", "planar-3r", "-n", "3", "-o", str(file)]
    subprocess.run(made, check=True, capture_output=True)
    command = [*program, "view", str(file), "--port", str(free_port())]
    with subprocess.Popen(
        command,
        stderr=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | {"TMPDIR": str(tmp_path)},
    ) as process:
        assert process.stderr is not None
        process.stderr.readline()
        process.send_signal(number)
        process.communicate(timeout=60)
    for _ in range(100):
        try:
            os.killpg(process.pid, 0)
        except ProcessLookupError:
            break
        time.sleep(0.05)
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)
    assert os.listdir(tmp_path) == ["m.h5"]
