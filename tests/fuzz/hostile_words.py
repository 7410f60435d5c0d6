"""Texts that mean something to a language of a product, and files that hold them everywhere."""

import io
from collections.abc import Iterator
from xml.sax.saxutils import escape, quoteattr

import h5py

from calibtool.robot.robot import Robot

# What ends a comment, a string, a line or an element somewhere, and what starts something.
WORDS = (
    "*/ int injected(void) { return 1; } /*",
    "*??/\n/ int injected; /* */",
    "a\\\n// b",
    "*) injected := 1; (*",
    "{attribute 'x'} // (* /* */",
    "--> <injected/> <!--",
    "a---b----",
    "a--",
    '"\ninjected = 1\n[injected]\n"""\n\'\'\'',
    "\\",
    '\\" injected = "',
    "=cmd|' /C calc'!A0",
    "+1+cmd|x!A0",
    "-2+3",
    "@SUM(1)",
    "\t=1",
    "\x1b[2J\x1b]0;title\x07",
    "a\u2028b\x85c\u202ed",
    "</script><script>injected()</script>",
    "<img src=x onerror=injected()>",
    "\"'><injected>",
    "$\\frac{$ $x^{$",
    "{{ 7 * 7 }}{% for %}",
    "%s%n{0}",
    "a\r\nb,c;d\te",
)


# Several at once, for products that take seconds to make; each ends in another one.
TOGETHER = (*("".join(WORDS[k::3]) for k in range(3)), "\\", "a---")


def texts_of(data: bytes) -> list[tuple[str, str]]:
    """Every text of an HDF5 file: the path of its item, and the attribute, '' for a dataset."""
    found: list[tuple[str, str]] = []

    def visit(path: str, item: h5py.Group | h5py.Dataset) -> None:
        found.extend((path, key) for key in item.attrs if item.attrs.get_id(key).dtype.kind in "SO")
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "SO":
            found.append((path, ""))

    with h5py.File(io.BytesIO(data), "r") as file:
        visit("/", file)
        file.visititems(visit)
    return [place for place in found if place[1] not in ("DIMENSION_LABELS", "CLASS", "NAME")]


def with_texts(data: bytes, places: list[tuple[str, str]], word: str) -> bytes:
    """The file with this text in all these places; keys of provenance are added."""
    buffer = io.BytesIO(data)
    with h5py.File(buffer, "r+") as file:
        for path, key in places:
            item = file[path]
            if key:
                item.attrs[key] = word.replace("\0", "")
            else:
                shape = item.shape
                del file[path]
                file[path] = [word] * shape[0] if shape else word
        if "provenance" in file:
            file["provenance"].attrs[word] = word
    return buffer.getvalue()


def urdf_with(robot: Robot, word: str) -> str:
    """The URDF of a robot whose joints and links are called by a text."""
    text = robot.source.urdf_text
    for name in _names(text):
        text = text.replace(f'"{name}"', quoteattr(f"{name}{word}", {"\n": "&#10;"}))
    return text.replace("<robot ", f"<!-- {escape(word).replace('--', '- -')} -->\n<robot ", 1)


def _names(text: str) -> Iterator[str]:
    from xml.etree import ElementTree

    for tag in ("joint", "link"):
        for part in ElementTree.fromstring(text).iterfind(tag):
            yield part.get("name", "")
