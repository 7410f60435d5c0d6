"""ROS 2 bags: joint states and poses of a moving arm, with two clocks."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from commandline import answer, refused, run, stored

from calibtool.measurement.simulate import Simulation, simulate
from calibtool.robot.catalogue import load_robot

UR10 = ("--robot", "ur10")
ARM = load_robot("ur10")
OFFSET = 0.04  # s that the stamps of the points are early
T0 = 1_764_000_000.0


def trajectory(times: np.ndarray) -> np.ndarray:
    rates = 0.5 * np.array([0.31, 0.47, 0.59, 0.73, 0.89, 1.03]) * 2 * np.pi
    middle = np.array([0.2, -1.2, 1.3, -1.4, -1.2, 0.3])
    return middle + 0.7 * np.sin(times[:, None] * rates + np.arange(6))


def written(path: str, storage: str, points_topics: tuple[str, ...] = ("/tracker",)) -> None:
    pytest.importorskip("rosbags")
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = {name: store.types[name] for name in store.types}

    def header(stamp: float) -> Any:
        seconds = int(stamp)
        time = types["builtin_interfaces/msg/Time"](
            sec=seconds, nanosec=round((stamp - seconds) * 1e9)
        )
        return types["std_msgs/msg/Header"](stamp=time, frame_id="")

    times, stamps = np.arange(-1.0, 13.0, 0.01), np.arange(120) * 0.1
    points = simulate(ARM, Simulation(3, at=trajectory(stamps + OFFSET))).points[:, 0]
    names = list(ARM.chain.bodies.joints)
    order = [3, 0, 5, 1, 2, 4]  # of the driver, not of the chain
    with Writer(Path(path), version=9, storage_plugin=StoragePlugin[storage]) as bag:
        kind = "sensor_msgs/msg/JointState"
        joints = bag.add_connection("/joint_states", kind, typestore=store)
        for time, q in zip(times, trajectory(times), strict=True):
            message = types[kind](
                header=header(T0 + time),
                name=[names[k] for k in order],
                position=q[order],
                velocity=np.zeros(0),
                effort=np.zeros(0),
            )
            bag.write(joints, int((T0 + time) * 1e9), store.serialize_cdr(message, kind))
        kind = "geometry_msgs/msg/PointStamped"
        for topic in points_topics:
            tracker = bag.add_connection(topic, kind, typestore=store)
            for time, (x, y, z) in zip(stamps, points, strict=True):
                point = types["geometry_msgs/msg/Point"](x=x, y=y, z=z)
                message = types[kind](header=header(T0 + time), point=point)
                bag.write(tracker, int((T0 + time) * 1e9), store.serialize_cdr(message, kind))


@pytest.mark.parametrize("storage", ["SQLITE3", "MCAP"])
def test_a_bag_is_two_streams_with_an_offset_between_them(storage: str) -> None:
    written("bag", storage)
    said = run("import", "bag", *UR10, "--clock-offset", "auto", "-o", "m.h5").stderr
    assert "note: bag: joints from /joint_states, measured from /tracker" in said
    offset = float(said.split("clock offset ")[1].split(" s")[0])
    assert offset == pytest.approx(OFFSET, abs=0.2e-3)
    assert "warning" not in said
    q = stored("m.h5", "measurements/joint_positions")
    assert np.abs(q - trajectory(np.arange(120) * 0.1 + OFFSET)).max() < 1e-3
    assert answer("info", "m.h5")["configurations"] == 120


def test_topics_are_named_where_there_are_several() -> None:
    written("bag", "MCAP", ("/left", "/right"))
    message = refused(2, "import", "bag", *UR10, "-o", "m.h5")
    assert "several topics of poses or points: /left, /right; give --topics" in message
    right = ("--topics", "/joint_states,/right", "--clock-offset", "auto")
    run("import", "bag", *UR10, *right, "-o", "m.h5")
    message = refused(2, "import", "bag", *UR10, "--topics", "/joint_states,/rihgt", "-o", "n.h5")
    assert "no topic '/rihgt'" in message
    left = ("--topics", "/joint_states,/left", "-o", "n.h5")
    message = refused(3, "import", "bag", "--robot", "panda", *left)
    assert "bag: /joint_states: no joint 'panda_joint1' of panda" in message


def test_what_is_no_bag_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    Path("x.mcap").write_bytes(b"nothing of it")
    pytest.importorskip("rosbags")
    assert refused(3, "import", "x.mcap", *UR10, "-o", "m.h5").startswith("x.mcap: not a readable")
    assert refused(2, "import", "y.mcap", *UR10, "-o", "m.h5") == "y.mcap: no such file"
    Path("t.csv").write_text("j1_deg\n")
    message = refused(2, "import", "t.csv", *UR10, "--topics", "a,b", "-o", "m.h5")
    assert message.startswith("--topics: t.csv is no ROS bag")
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    message = refused(2, "import", "x.mcap", *UR10, "-o", "m.h5")
    assert "pip install 'calibtool[ros]'" in message
