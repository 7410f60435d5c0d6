"""xacro files, expanded to URDFs by xacrodoc (extra `xacro`)."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from calibtool.errors import InputError
from calibtool.robot.markup import decoded_xml, parse_xml
from calibtool.robot.named_files import contents

_MANIFEST = "package.xml"
_NO_VALUE = re.compile(r"Undefined substitution argument (\S+)")
_NO_PACKAGE = re.compile(r"Package not found: (\S+)")


def expanded_xacro(path: Path, allowed: Iterable[Path] = ()) -> str:
    """The URDF that a xacro file makes.

    Packages that it names are looked for among those beside its own, in the allowed folders, and
    where ROS has them. InputError where it cannot be expanded, with the remedy.
    """
    try:
        from xacrodoc import XacroDoc, packages
    except ImportError:
        raise InputError(
            f"{path}: a xacro file, from which a URDF is made; run: xacro {path.name} > robot.urdf "
            "(in ROS), or pip install 'calibtool[xacro]'"
        ) from None
    packages.reset()
    packages.update_package_cache(dict(_packages(path, allowed)))
    try:
        urdf = str(XacroDoc.from_file(str(path)).to_urdf_string())
    except Exception as error:  # whatever the expressions of a file do
        raise InputError(f"{path}: xacro cannot expand it: {_why(error, path)}") from None
    if parse_xml(urdf, str(path), "URDF").find("link") is None:
        raise InputError(
            f"{path}: a xacro file without links, a part of a robot; give the file that includes it"
        )
    return urdf


def _why(error: Exception, path: Path) -> str:
    message = str(error).strip()
    if found := _NO_VALUE.search(message):
        return (
            f"its argument '{found[1]}' has no default; run: xacro {path.name} "
            f"{found[1]}:=VALUE > robot.urdf"
        )
    if found := _NO_PACKAGE.search(message):
        return f"package '{found[1]}' is not found; allow the folder that it is in: --allow FOLDER"
    return message.splitlines()[0] if message else type(error).__name__


def _packages(path: Path, allowed: Iterable[Path]) -> Iterator[tuple[str, str]]:
    """Packages beside that of a file, and in the allowed folders, by name."""
    own = next((above for above in path.resolve().parents if (above / _MANIFEST).is_file()), None)
    folders = [*allowed, *([own.parent] if own else [])]
    for folder in folders:
        for each in (folder, *sorted(folder.iterdir())):
            manifest = each / _MANIFEST
            if manifest.is_file():
                text = decoded_xml(contents(manifest), str(manifest))
                name = parse_xml(text, str(manifest), "manifest").findtext("name")
                yield (name or each.name).strip(), str(each)
