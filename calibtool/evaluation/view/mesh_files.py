"""Meshes from outside, without the files that they refer to: material libraries, textures, other
files.

The libraries that read meshes open whatever a mesh names, wherever it lies, and block
on a named pipe. They are therefore given copies without references.
"""

import re
from collections.abc import Callable
from xml.etree import ElementTree

from calibtool.robot.markup import decoded_xml, parse_xml

_OF_SHAPE = {b"v", b"vn", b"vt", b"f", b"g", b"o", b"s"}  # statements of an OBJ file


def _obj(data: bytes, place: str) -> bytes:
    """Vertices, faces and their groups."""
    lines = re.sub(rb"\\[ \t]*\r?\n", b" ", data).splitlines()
    return b"\n".join(line for line in lines if line.split()[:1] and line.split()[0] in _OF_SHAPE)


def _dae(data: bytes, place: str) -> bytes:
    """The document without the names of its images."""
    root = parse_xml(decoded_xml(data, place), place, "mesh")
    for element in root.iter():
        if element.tag.rpartition(":")[2] == "init_from":
            element.clear()
    return bytes(ElementTree.tostring(root, "utf-8"))


def _ply(data: bytes, place: str) -> bytes:
    """The file without the comments of its header, which may name textures."""
    head, end, rest = data.partition(b"end_header")
    kept = [line for line in head.splitlines(keepends=True) if not line.startswith(b"comment")]
    return b"".join(kept) + end + rest


def _stl(data: bytes, place: str) -> bytes:
    return data


# What Pinocchio and trimesh both read, and how it is kept to itself; InputError, with the place,
# for what is no such mesh.
ALONE: dict[str, Callable[[bytes, str], bytes]] = {
    ".stl": _stl,
    ".dae": _dae,
    ".obj": _obj,
    ".ply": _ply,
}
