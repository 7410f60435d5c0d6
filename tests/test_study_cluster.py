"""The same runs on a real Dask cluster of two processes, one of which is killed."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calibtool.errors import CalibtoolError, InputError, UsageError
from calibtool.evaluation.study import Definition, Study, cluster, perform
from calibtool.evaluation.study.cluster import on_cluster
from calibtool.evaluation.study.cluster_security import parse_security

STUDY = Study.of(
    Definition(
        robots=["fanuc-m1000ia"], runs=10, configurations=[20], fresh=10, methods=["local-poe"]
    )
)


def test_a_worker_is_killed_and_nothing_is_lost() -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        found = {}
        for index, rows in on_cluster(STUDY, range(STUDY.count), cluster.scheduler_address):
            if not found:
                os.kill(cluster.workers[0].pid, signal.SIGKILL)
            found[index] = rows
    assert found == {index: perform(STUDY, index) for index in range(STUDY.count)}


@pytest.mark.parametrize("address", ["nonsense", "foo://here:1"])
def test_an_address_that_is_none(address: str) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(UsageError, match="no Dask scheduler"):
        next(on_cluster(STUDY, [0], address))


def test_an_address_that_does_not_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("calibtool.evaluation.study.cluster.REACH_SECONDS", 1.2)
    with pytest.raises(UsageError, match=r"tcp://127\.0\.0\.1:9: no Dask scheduler"):
        next(on_cluster(STUDY, [0], "tcp://127.0.0.1:9"))


def test_without_dask_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(UsageError, match=r"calibtool\[cluster\]"):
        next(on_cluster(STUDY, [0], "tcp://127.0.0.1:8786"))


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (None, "the cluster is lost: it has dropped the runs"),
        (CalibtoolError("install the same calibtool"), "install the same calibtool"),
        (
            ImportError("No module named 'calibtool'"),
            "a worker cannot perform runs: No module named 'calibtool'; install",
        ),
        (ZeroDivisionError("a\nb"), "a worker failed: ZeroDivisionError: a b"),
    ],
)
def test_what_stops_a_cluster_is_one_line(error: Exception | None, words: str) -> None:
    line = cluster._reason("tcp://a:8786", error)
    assert line.startswith(f"tcp://a:8786: {words}")
    assert "\n" not in line


def scheduler(*options: str) -> tuple[subprocess.Popen[bytes], int]:
    """A scheduler of its own process, without workers, and its port."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    program = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    options = ("--host", "127.0.0.1", "--port", str(port), *options)
    process = subprocess.Popen([*program, *options], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    for _ in range(300):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return process, port
        time.sleep(0.1)
    raise AssertionError("the scheduler does not start")


def test_a_scheduler_without_workers_says_so_and_a_dying_one_once(tmp_path: Path) -> None:
    """Two lines: there are no workers; then, killed, the end."""
    pytest.importorskip("distributed")
    process, port = scheduler()
    address = f"tcp://127.0.0.1:{port}"
    command = [sys.executable, "-m", "calibtool", "study", "planar-3r", "--runs", "2"]
    study = subprocess.Popen(
        [*command, "--cluster", address, "-o", str(tmp_path / "s.csv")],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert study.stderr is not None
    first = study.stderr.readline()
    process.kill()
    process.communicate()
    _, rest = study.communicate(timeout=120)
    assert first.startswith(f"{address}: no workers yet; waiting for some")
    assert rest.startswith(f"{address}: the cluster is lost")
    assert rest.count("\n") == 1
    assert study.returncode == 1


def certificates(folder: Path) -> Path:
    """A key, a certificate that it signs itself, and the TOML that names them."""
    words = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=localhost"
    subprocess.run(
        [*words.split(), "-keyout", "key.pem", "-out", "cert.pem"],
        cwd=folder,
        check=True,
        capture_output=True,
    )
    names = {"tls_ca_file": "cert", "tls_client_cert": "cert", "tls_client_key": "key"}
    path = folder / "tls.toml"
    path.write_text("".join(f'{name} = "{file}.pem"\n' for name, file in names.items()))
    return path


def test_a_cluster_with_tls(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificates")
    path = certificates(tmp_path)
    security = parse_security(path.read_text(), "tls.toml", tmp_path)
    every = {f"tls_{role}_cert": str(security.tls_client_cert) for role in ("scheduler", "worker")}
    every |= {f"tls_{role}_key": str(security.tls_client_key) for role in ("scheduler", "worker")}
    with distributed.LocalCluster(
        n_workers=1,
        processes=False,
        dashboard_address=None,
        silence_logs=50,
        security=distributed.Security(**security.options, **every),
        protocol="tls",
    ) as made:
        address = made.scheduler_address
        assert address.startswith("tls://")
        found = dict(on_cluster(STUDY, [3], address, security))
        with pytest.raises(UsageError, match="no Dask scheduler"):
            next(on_cluster(STUDY, [3], address))
    assert found == {3: perform(STUDY, 3)}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("tls_ca_file = 'a'", "tls_client_cert: Field required"),
        ("tls_ca_file = 'a'\ntls_client_cert = 'a'\ntls_client_key = 'b'", "b: no such file"),
        ("tls_ca_fil = 'a'", "unknown key 'tls_ca_fil'"),
        ("[", "not valid TOML"),
    ],
)
def test_files_of_tls_that_are_not_there(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / "a").write_text("")
    with pytest.raises(InputError, match=rf"^t\.toml: .*{why}"):
        parse_security(text, "t.toml", tmp_path)
