"""xacro files: the packages that they find, and what is said where they cannot be expanded."""

import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

from calibtool.errors import InputError
from calibtool.robot.catalogue import load_robot

XACRO = '<robot name="a" xmlns:xacro="x"><xacro:include filename="h"/></robot>'


@pytest.fixture
def expander(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Stands for xacrodoc: `answer` is a URDF, or the error that expanding ends with."""
    seen = SimpleNamespace(packages={}, answer="")

    def from_file(path: str) -> SimpleNamespace:
        if isinstance(seen.answer, Exception):
            raise seen.answer
        return SimpleNamespace(to_urdf_string=lambda: seen.answer)

    module = ModuleType("xacrodoc")
    module.XacroDoc = SimpleNamespace(from_file=from_file)  # type: ignore[attr-defined]
    module.packages = SimpleNamespace(  # type: ignore[attr-defined]
        reset=seen.packages.clear, update_package_cache=seen.packages.update
    )
    monkeypatch.setitem(sys.modules, "xacrodoc", module)
    return seen


def package(folder: Path, name: str) -> Path:
    folder.mkdir(parents=True)
    (folder / "package.xml").write_text(f"<package><name> {name} </name></package>")
    return folder


URDF = load_robot("planar-3r").source.urdf_text


def test_packages_beside_its_own_and_allowed_ones_are_found(
    tmp_path: Path, expander: SimpleNamespace
) -> None:
    own = package(tmp_path / "repository/arm_support", "arm_support")
    meshes = package(tmp_path / "repository/common", "arm_resources")
    other = package(tmp_path / "elsewhere/more", "more_resources")
    package(tmp_path / "hidden/secret", "secret")
    (own / "urdf").mkdir()
    file = own / "urdf/arm.xacro"
    file.write_text(XACRO)
    expander.answer = URDF
    robot = load_robot(str(file), allowed=(tmp_path / "elsewhere",))
    assert robot.n == 3
    assert expander.packages == {
        "arm_support": str(own),
        "arm_resources": str(meshes),
        "more_resources": str(other),
    }


@pytest.mark.parametrize(
    ("answer", "finding"),
    [
        (ValueError("Undefined substitution argument ur_type"), r"run: xacro arm\.xacro ur_type:="),
        (ValueError("<class 'x'>: Package not found: common"), "'common' is not found.*--allow"),
        (ValueError("name 'h' is not defined\nwhen"), "cannot expand it: name 'h' is not defined$"),
        ("<robot name='a'/>", "without links, a part of a robot"),
    ],
)
def test_what_cannot_be_expanded_says_why(
    answer: object, finding: str, tmp_path: Path, expander: SimpleNamespace
) -> None:
    (tmp_path / "arm.xacro").write_text(XACRO)
    expander.answer = answer
    with pytest.raises(InputError, match=finding) as caught:
        load_robot(str(tmp_path / "arm.xacro"))
    assert "\n" not in str(caught.value)
