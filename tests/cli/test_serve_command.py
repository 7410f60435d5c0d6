"""calibtool serve: a stream on stdin and stdout, and a socket of this machine."""

import json
import re
import socket
import struct
import subprocess
import sys

from commandline import ENVIRONMENT, Files, refused, run

ROWS = [{"j1_deg": 10.0 + k, "j2_deg": 40.0, "j3_deg": -30.0, "id": k} for k in range(5)]


def test_a_stream_of_objects(files: Files) -> None:
    stdin = "".join(json.dumps(row) + "\n" for row in ROWS) + "\n?\n"
    result = run("serve", files.network, stdin=stdin)
    *answers, last = (json.loads(line) for line in result.stdout.splitlines())
    assert [answer["id"] for answer in answers] == [0, 1, 2, 3, 4]
    assert all({"j1_deg", "j2_deg", "j3_deg", "status"} < set(answer) for answer in answers)
    assert last["error"].startswith("not JSON")
    again = run("compensate", files.network, "-", "--method", "one-step", stdin=stdin[:-3])
    for answer, line in zip(answers, again.stdout.splitlines(), strict=True):
        wanted = json.loads(line)
        assert answer["status"] == wanted["status"]
        assert abs(answer["j2_deg"] - wanted["j2_deg"]) < 1e-5


def test_a_stream_of_doubles(files: Files) -> None:
    rows = struct.pack("<6d", 0.2, 0.7, -0.5, 0.21, 0.7, -0.5) + b"a part of a row"
    result = run("serve", files.network, "--rows", "binary", stdin=rows)
    assert len(result.stdout_bytes) == 2 * 4 * 8
    first = struct.unpack("<4d", result.stdout_bytes[:32])
    assert abs(first[1] - 0.7) < 0.05
    assert first[3] in range(10)


def test_a_socket_answers_several_clients_at_once(files: Files) -> None:
    command = [sys.executable, "-m", "calibtool", "serve", files.network, "--port", "0"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=ENVIRONMENT, text=True) as server:
        try:
            assert server.stderr is not None
            said = server.stderr.readline()
            port = int(re.fullmatch(r"serving 127\.0\.0\.1:(\d+) until ended\n", said)[1])
            clients = [socket.create_connection(("127.0.0.1", port), 20) for _ in range(2)]
            for row in ROWS:
                for client in clients:
                    client.sendall(json.dumps(row).encode() + b"\n")
                answers = [client.makefile("rb").readline() for client in clients]
                assert answers[0] == answers[1]
                assert json.loads(answers[0])["id"] == row["id"]
            for client in clients:
                client.close()
        finally:
            server.terminate()
    assert server.returncode == 143


def test_what_cannot_be_served_is_refused(files: Files) -> None:
    assert "stdin holds the rows" in refused(2, "serve", "-")
    assert "--rows: unknown 'csv'" in refused(2, "serve", files.network, "--rows", "csv")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        message = refused(2, "serve", files.network, "--port", port)
    assert message.startswith(f"port {port}: ")
