"""The scripts of benchmarks/peers: they compile, count honestly, and explain peers
that are missing.
"""

import importlib
import py_compile
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PEERS = Path(__file__).resolve().parent.parent / "benchmarks" / "peers"
SCRIPTS = sorted(PEERS.glob("*.py"))


@pytest.fixture
def peer(monkeypatch: pytest.MonkeyPatch):
    """Import a script as it is imported when run: from its own folder."""
    monkeypatch.syspath_prepend(str(PEERS))
    before = set(sys.modules)

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield load
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "").parent == PEERS:
            del sys.modules[name]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_scripts_compile(script, tmp_path):
    py_compile.compile(str(script), cfile=str(tmp_path / "out.pyc"), doraise=True)


def test_requirements_are_pinned_and_name_no_address():
    lines = (PEERS / "requirements.txt").read_text(encoding="utf-8").splitlines()
    packages = [line for line in lines if line and not line.startswith("#")]
    assert all(
        line.count("==") == 1 and "/" not in line and not line.startswith("-") for line in packages
    )


def test_a_missing_peer_is_a_line_of_the_table(peer, tmp_path, capsys):
    geometry = peer("geometry")
    geometry.write_case(tmp_path, "placements", 0)
    geometry.ENTRIES = (geometry.Entry("nobody's tool", "no_such_package", {}, 1),)
    geometry.table([tmp_path], 1)
    out = capsys.readouterr().out
    assert (
        "nobody's tool | skipped: no_such_package is not installed (pip install -r "
        "benchmarks/peers/" in out
    )


def test_run_states_why_a_table_is_missing(peer, monkeypatch):
    run = peer("run")

    def fails(arguments):
        raise run.PeerError("failed: ImportError: no such thing")

    monkeypatch.setattr(run, "output", fails)
    assert "No table: failed: ImportError: no such thing" in run.section("training", 1)


def test_versions_name_what_is_not_installed(peer, monkeypatch):
    run = peer("run")
    monkeypatch.setattr(run, "PACKAGES", ("numpy", "no-such-package"))
    assert run.versions().endswith(f"numpy {np.__version__}, no-such-package not installed")


def test_the_urdf_is_the_mdh_robot(peer, tmp_path):
    geometry = peer("geometry")
    geometry.write_case(tmp_path, "mdh", 0)
    from calibtool.robot.catalogue import load_robot

    q = np.random.default_rng(1).uniform(-3, 3, 6)
    T = np.eye(4)
    for (alpha, a, theta, d), angle in zip(
        geometry.MDH, q, strict=True
    ):  # Craig: Rx(α) Tx(a) Rz(θ + q) Tz(d)
        link = np.eye(4)
        link[:3, :3] = (
            Rotation.from_rotvec([alpha, 0, 0]) * Rotation.from_rotvec([0, 0, theta + angle])
        ).as_matrix()
        link[:3, 3] = [a / 1e3, *Rotation.from_rotvec([alpha, 0, 0]).apply([0, 0, d / 1e3])[1:]]
        T = T @ link
    np.testing.assert_allclose(
        load_robot(str(tmp_path / "robot.urdf")).mechanism.forward(q[None])[0], T, atol=1e-12
    )


def test_the_simulated_mdh_robot_has_mdh_parameters(peer):
    geometry = peer("geometry")
    from calibtool.robot.catalogue import load_robot
    from calibtool.robot.se3 import exp6

    errors = geometry.geometric_errors("mdh", load_robot("ur10"), np.random.default_rng(0))

    placements = geometry.mdh_placements(geometry.MDH) @ exp6(errors["placements"][:6])
    np.testing.assert_allclose(
        placements[:, 0, 2], 0.0, atol=1e-12
    )  # a turn about the common normal, then about z
    assert not errors["twists"].any()
    assert not errors["offsets"].any()
