"""The scripts of benchmarks/peers: they compile, count honestly, and explain peers
that are missing.
"""

import argparse
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


@pytest.mark.parametrize("file", ["requirements.txt", "requirements-numpy1.txt"])
def test_requirements_are_pinned_and_name_no_address(file):
    lines = (PEERS / file).read_text(encoding="utf-8").splitlines()
    packages = [line for line in lines if line and not line.startswith("#")]
    assert all(
        line.count("==") == 1 and "/" not in line and not line.startswith("-") for line in packages
    )


def test_a_missing_peer_is_a_line_of_the_table(peer, tmp_path, capsys):
    geometry = peer("geometry")
    geometry.write_case(tmp_path, "placements", 0)
    geometry.ENTRIES = (geometry.Entry("nobody's tool", "no_such_package", {}, 1),)
    geometry.table([tmp_path], 1, geometry.Interpreters())
    out = capsys.readouterr().out
    assert (
        "nobody's tool | skipped: no_such_package is not installed (pip install -r "
        "benchmarks/peers/" in out
    )


def test_run_states_why_a_table_is_missing(peer, monkeypatch):
    run = peer("run")

    def fails(arguments, python=""):
        raise run.PeerError("failed: ImportError: no such thing")

    monkeypatch.setattr(run, "output", fails)
    text = run.section("training", 1, run.Interpreters())
    assert "No table: failed: ImportError: no such thing" in text


def test_versions_name_what_is_not_installed(peer, monkeypatch):
    run = peer("run")
    monkeypatch.setattr(run, "PACKAGES", {"training": {"no_such": "no-such-package"}})
    told = run.versions("training", run.Interpreters())
    assert f"no-such-package not installed, numpy {np.__version__}, scipy" in told


def test_a_peer_runs_in_the_interpreter_that_was_given(peer, tmp_path):
    process = peer("process")
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\nOWN=1 exec {sys.executable} "$@"\n')
    python.chmod(0o755)
    parser = argparse.ArgumentParser()
    process.add_interpreters(parser)
    given = process.interpreters(parser.parse_args(["--python", f"numpy={python}"]))
    script = ["-c", "import os; print(os.environ.get('OWN'))"]
    process.require("numpy", given["numpy"])
    assert process.output(script, given["numpy"]).strip() == "1"
    assert process.output(script, given["figaroh"]).strip() == "None"


@pytest.mark.parametrize("text", ["numpy", "numpy=", "=python"])
def test_an_interpreter_is_a_pair(peer, text):
    process = peer("process")
    parser = argparse.ArgumentParser()
    process.add_interpreters(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["--python", text])


def test_an_interpreter_that_is_not_there_is_a_line_of_the_table(peer):
    process = peer("process")
    with pytest.raises(process.PeerError, match="skipped: numpy: no interpreter"):
        process.require("numpy", "/no/such/python")


def test_one_section_is_made_again_and_the_others_stay(peer, monkeypatch, tmp_path):
    run, page = peer("run"), tmp_path / "peers.md"
    monkeypatch.setattr(run, "section", lambda name, *_: f"{run.COMPARISONS[name]}\nold {name}\n")
    monkeypatch.setattr(sys, "argv", ["run.py", "--output", str(page)])
    run.main()
    monkeypatch.setattr(run, "section", lambda name, *_: f"{run.COMPARISONS[name]}\nnew {name}\n")
    monkeypatch.setattr(sys, "argv", ["run.py", "--output", str(page), "--only", "training"])
    run.main()
    lines = page.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if line.startswith(("old", "new"))] == [
        "old geometry",
        "new training",
        "old kinematics",
    ]
    assert len([line for line in lines if line.startswith("## ")]) == 3


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
