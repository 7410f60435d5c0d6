"""ROS 2 bags and mcap files as two tables with stamps. Needs rosbags, extra `ros`."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.robot import Robot
from calibtool.tables import format_table

_JOINTS = "sensor_msgs/msg/JointState"
_MEASURED = {  # where the position and the orientation of a message are
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
    "geometry_msgs/msg/PointStamped": ("point", None),
}
_SUFFIXES = (".mcap", ".db3", ".bag")


class BagTables(NamedTuple):
    """Two tables as CSV text, and the topics from which they are."""

    measured: str
    joints: str
    note: str


def is_bag(path: str) -> bool:
    """Whether a path is a bag, by its suffix or, of a folder, by its metadata."""
    return path.lower().endswith(_SUFFIXES) or (Path(path) / "metadata.yaml").is_file()


def read_bag(path: Path, robot: Robot, topics: Sequence[str] = ()) -> BagTables:
    """The joint states of a bag and its poses, transforms or points, with the stamps of their
    headers.

    topics: of the joint states and of what was measured, where there are several. Raises
    UsageError without rosbags or for an unknown topic, InputError for what is no bag or does not
    hold both.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise UsageError(
            f"{path}: reading ROS bags needs rosbags; run: pip install 'calibtool[ros]' (or export "
            "the topics as CSV)"
        ) from None
    if not path.exists():
        raise UsageError(f"{path}: no such file")
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            types = {c.topic: c.msgtype for c in reader.connections}
            joints = _topic(path, types, [_JOINTS], "joint states", topics[:1])
            measured = _topic(path, types, list(_MEASURED), "poses or points", topics[1:2])
            messages = {joints: [], measured: []}  # type: dict[str, list[tuple[float, Any]]]
            chosen = [c for c in reader.connections if c.topic in messages]
            for connection, bag_time, raw in reader.messages(connections=chosen):
                message = reader.deserialize(raw, connection.msgtype)
                messages[connection.topic].append((_stamp(message, bag_time), message))
    except (InputError, UsageError):
        raise
    except Exception as error:  # rosbags checks little: a damaged bag fails in any way
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise InputError(f"{path}: not a readable ROS bag: {reason}") from None
    if not messages[joints] or not messages[measured]:
        empty = joints if not messages[joints] else measured
        raise InputError(f"{path}: no message of {empty} in it")
    start = min(stamp for part in messages.values() for stamp, _ in part)
    return BagTables(
        _measured_table(messages[measured], types[measured], start),
        _joint_table(f"{path}: {joints}", messages[joints], robot, start),
        f"{path}: joints from {joints}, measured from {measured}",
    )


def _topic(
    path: Path, types: dict[str, str], wanted: list[str], what: str, asked: Sequence[str]
) -> str:
    """The one topic of these types, or the requested one."""
    fitting = sorted(topic for topic, kind in types.items() if kind in wanted)
    if asked:
        if asked[0] not in fitting:
            raise UsageError(
                f"--topics: no topic '{asked[0]}' of {what}; {near_names(asked[0], fitting)}"
            )
        return asked[0]
    if len(fitting) == 1:
        return fitting[0]
    if not fitting:
        raise InputError(f"{path}: no topic of {what} ({', '.join(wanted)})")
    raise UsageError(
        f"{path}: several topics of {what}: {', '.join(fitting)}; give --topics JOINTS,MEASURED"
    )


def _stamp(message: Any, bag_time: int) -> float:
    """When it was measured, s: the header's stamp, or the bag's where that is not set."""
    stamp = message.header.stamp
    own = stamp.sec * 10**9 + stamp.nanosec
    return float((own or bag_time) * 1e-9)


def _joint_table(place: str, messages: list[tuple[float, Any]], robot: Robot, start: float) -> str:
    wanted = list(robot.chain.bodies.joints[: robot.n])
    columns = [f"j{i + 1}_{unit}" for i, unit in enumerate(robot.joint_units)]
    rows = []
    for stamp, message in messages:
        names = list(message.name)
        missing = [joint for joint in wanted if joint not in names]
        if missing:
            raise InputError(
                f"{place}: no joint '{missing[0]}' of {robot.name}; {near_names(missing[0], names)}"
            )
        position = np.asarray(message.position, dtype=float)
        if len(position) < len(names):
            raise InputError(f"{place}: {len(position)} positions for {len(names)} names")
        values = [position[names.index(joint)] for joint in wanted]
        rows.append([f"{stamp - start:.9f}", *(f"{v:.12g}" for v in values)])
    return format_table(["time_s", *columns], rows)


def _measured_table(messages: list[tuple[float, Any]], kind: str, start: float) -> str:
    where, turn = _MEASURED[kind]

    def rows() -> Iterator[list[str]]:
        for stamp, message in messages:
            place = _at(message, where)
            values = [place.x, place.y, place.z]
            if turn is not None:
                q = _at(message, turn)
                values += [q.w, q.x, q.y, q.z]
            yield [f"{stamp - start:.9f}", *(f"{v:.12g}" for v in values)]

    orientation = [] if turn is None else ["qw", "qx", "qy", "qz"]
    return format_table(["time_s", "x_m", "y_m", "z_m", *orientation], list(rows()))


def _at(message: Any, path: str) -> Any:
    for name in path.split("."):
        message = getattr(message, name)
    return message
