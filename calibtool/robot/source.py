"""The source of a robot: a description and the texts from which it was read."""

from dataclasses import dataclass, replace
from pathlib import Path

from calibtool.errors import InputError, UsageError, near_names
from calibtool.robot.description import Description, Kinematics
from calibtool.robot.named_files import contents, inside
from calibtool.robot.toml_text import parse_toml, read_model
from calibtool.robot.tool import Choice, chosen, quoted
from calibtool.robot.tree import urdf_tree
from calibtool.robot.urdf_text import Converted

_IN_FOLDERS = ("robot.toml", "robot.yaml")


@dataclass(frozen=True)
class Source:
    """A description with the texts that it was read from, to build the robot again."""

    description: Description
    toml_text: str
    urdf_text: str
    place: str  # where it was read, for messages


def parse_source(toml_text: str, urdf_text: str, place: str) -> Source:
    """Validate the text of a robot.toml.

    Raises InputError with `place`, the key and what is wrong.
    """
    return Source(
        read_model(Description, parse_toml(toml_text, place), place), toml_text, urdf_text, place
    )


def read_source(path: Path, tool: str | None = None, allowed: tuple[Path, ...] = ()) -> Source:
    """Read `path`: a folder with a robot.toml, or a file that `contents.recognise` knows.

    tool: the tool frame of a description that does not name it; UsageError for one that does.
    allowed: folders, besides that of the description, whose files it may name.
    """
    from calibtool.robot.contents import WHAT, converted, recognise
    from calibtool.robot.numeric_kinematics import numbers_as_urdf

    if path.is_dir():
        inside_it = [path / name for name in _IN_FOLDERS if (path / name).exists()]
        if not inside_it:
            raise InputError(
                f"{path / _IN_FOLDERS[0]}: No such file; give a folder with one, or the file of a "
                "description"
            )
        path = inside_it[0]
    kind, text = recognise(contents(path), path)
    if kind != "toml":
        return bare_source(converted(kind, text, path, allowed), path.stem, tool, WHAT[kind])
    description = read_model(Description, parse_toml(text, str(path)), str(path))
    kinematics = description.kinematics
    if tool is not None:
        raise UsageError(f"--tool: {path} names its tool_frame, '{kinematics.tool_frame}'")
    if kinematics.chain is not None or kinematics.dh is not None:
        return Source(description, text, numbers_as_urdf(description, str(path)), str(path))
    if kinematics.calibration is not None:
        return Source(description, text, _calibrated(path, kinematics, allowed), str(path))
    if kinematics.urdf is not None:
        urdf_path = inside(path.parent, kinematics.urdf, f"{path}: kinematics.urdf", allowed)
    else:
        name = str(kinematics.example_robot_data)
        urdf_path = inside(example_robot_data(), name, f"{path}: kinematics.example_robot_data")
    kind, urdf_text = recognise(contents(urdf_path), urdf_path)
    if kind == "toml":
        raise InputError(f"{path}: kinematics.urdf: {urdf_path} is a robot.toml itself")
    urdf_text = converted(kind, urdf_text, urdf_path, allowed).urdf
    return Source(description, text, urdf_text, str(path))


def _calibrated(path: Path, kinematics: Kinematics, allowed: tuple[Path, ...]) -> str:
    """The URDF of `nominal` with its `calibration`."""
    from calibtool.robot.catalogue import load_robot, robot_names
    from calibtool.robot.contents import recognise
    from calibtool.robot.universal_robots import calibrated_urdf

    place = f"{path}: kinematics.calibration"
    arms = [name for name in robot_names() if name.startswith("ur")]
    if kinematics.nominal not in arms:
        known = near_names(str(kinematics.nominal), arms)
        raise InputError(f"{path}: kinematics.nominal: no UR arm of the catalogue; {known}")
    file = inside(path.parent, str(kinematics.calibration), place, allowed)
    kind, text = recognise(contents(file), file)
    if kind not in ("ur-conf", "ur-yaml"):
        raise InputError(f"{place}: {file} is no calibration.conf or calibration.yaml of a UR arm")
    return calibrated_urdf(kind, text, str(file), load_robot(str(kinematics.nominal)))


def source_from_urdf(urdf_text: str, name: str) -> Source:
    """A description for a bare URDF: see `bare_source`."""
    return bare_source(Converted(urdf_text), name)


def bare_source(
    conversion: Converted, name: str, tool: str | None = None, what: str = "a bare URDF"
) -> Source:
    """The robot.toml for a bare URDF: see `tool.chosen`; three targets on a circle of 0.1 m.

    what: the kind of the description, for the message about assumptions. UsageError where several
    links could be the tool and `tool` does not name one.
    """
    from calibtool.robot.closed_chain import configuration_found  # Pinocchio is only needed here
    from calibtool.robot.urdf import parse_urdf

    parse_urdf(conversion.urdf, name)
    found = chosen(urdf_tree(conversion.urdf, name), name, tool, conversion)
    source = _assumed(found, conversion, name, what)
    if found.loops and found.actuated is not None and not found.closed_at:
        closed_at = configuration_found(source)
        source = _assumed(replace(found, closed_at=closed_at), conversion, name, what)
    return source


def _assumed(found: Choice, conversion: Converted, name: str, what: str) -> Source:
    allowed = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "-" for c in name)
    safe = allowed.lstrip("._-") or "robot"
    keys = found.toml.replace("\n", ", ")
    mounting = f"\n[mounting]\ngravity = {list(conversion.gravity)}\n" if conversion.gravity else ""
    assumed = f"{what}, taken as [kinematics] {keys}; the targets are assumed"
    toml_text = (
        f'name = "{safe}"\ntitle = "{safe}, from {what}"\n'
        f"assumed = {quoted(assumed)}\n\n"
        f'[kinematics]\nurdf = "robot.urdf"\n{found.toml}\n\n'
        "[targets]\npoints_mm = [[100.0, 0.0, 0.0], [-50.0, 86.6, 0.0], [-50.0, -86.6, 0.0]]\n"
        f"{mounting}"
    )
    return parse_source(toml_text, conversion.urdf, name)


def example_robot_data() -> Path:
    """Where the installed example-robot-data keeps its robots (its wheel has no Python module)."""
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        located = distribution("example-robot-data").locate_file(
            "cmeel.prefix/share/example-robot-data/robots"
        )
    except PackageNotFoundError:
        raise InputError(
            "example-robot-data is not installed; run: pip install example-robot-data"
        ) from None
    return Path(str(located))
