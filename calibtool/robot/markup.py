"""XML files: bytes → text by the declared encoding → a tree.

This parser alone decides what a file contains. Names keep their prefixes as they are written,
whether these are declared or not.
"""

import codecs
import re
from collections.abc import Callable
from typing import Any
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from calibtool.errors import InputError

_DEEPEST = 200  # levels of nested elements
_DECLARED = re.compile(rb"""^\s*<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
_COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
    (b"<\0", "utf-16-le"),
    (b"\0<", "utf-16-be"),
)


def is_xml(data: bytes) -> bool:
    """Whether bytes start like XML: with `<`, after a byte order mark and blanks."""
    marked = any(data.startswith(mark) for mark, _ in _MARKS[1:])
    return marked or data.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b"<")


def decoded_xml(data: bytes, name: str) -> str:
    """The text of an XML file: by its byte order mark, its declared encoding, or as UTF-8.

    InputError with `name` for an unknown encoding and for bytes that are not in it.
    """
    declared = _DECLARED.match(data)
    marked = (encoding for mark, encoding in _MARKS if data.startswith(mark))
    encoding = next(marked, declared[1].decode() if declared else "utf-8")
    try:
        return data.decode(encoding)
    except LookupError:
        raise InputError(f"{name}: the XML declares the unknown encoding '{encoding}'") from None
    except UnicodeError:
        known = "UTF-8" if encoding == "utf-8" else encoding
        raise InputError(
            f"{name}: not a {known} text file; declare its encoding: <?xml … encoding=…?>"
        ) from None


def parse_xml(text: str, name: str, what: str, *, comments: bool = False) -> Element:
    """The root of an XML text, whatever encoding it declares; `what` names its kind in messages.

    InputError for a document type or entities, and with the line for what is no XML. Two hyphens
    inside of a comment are forgiven, as readers of URDFs do.
    """
    text = text.lstrip("\ufeff \t\r\n")
    try:
        return _parsed(text, name, what, comments)
    except expat.ExpatError as error:
        forgiven = _COMMENT.sub(lambda found: "\n" * found[0].count("\n"), text)
        if re.search(r"<!(?:DOCTYPE|ENTITY)", forgiven, re.IGNORECASE):
            raise _refused(name, what) from None
        try:
            return _parsed(forgiven, name, what, comments)
        except expat.ExpatError:
            raise InputError(
                f"{name}: the {what} cannot be read: line {error.lineno}: "
                f"{expat.ErrorString(error.code)}; check it with an XML checker"
            ) from None


def _refused(name: str, what: str) -> InputError:
    return InputError(
        f"{name}: the {what} holds a document type or entities (<!DOCTYPE …>); expected plain XML"
    )


def _parsed(text: str, name: str, what: str, comments: bool) -> Element:
    builder, depth = TreeBuilder(insert_comments=comments), 0

    def refuse(*_: object) -> None:
        raise _refused(name, what)

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > _DEEPEST:
            raise InputError(f"{name}: the {what} is nested deeper than {_DEEPEST} elements")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    parser = expat.ParserCreate("utf-8")
    parser.buffer_text = True
    handlers: dict[str, Callable[..., Any]] = {
        "StartElementHandler": start,
        "EndElementHandler": end,
        "CharacterDataHandler": builder.data,
        "StartDoctypeDeclHandler": refuse,
        "EntityDeclHandler": refuse,
    }
    if comments:
        handlers["CommentHandler"] = lambda inside: builder.comment(inside) if depth else None
    for handler, does in handlers.items():
        setattr(parser, handler, does)
    parser.Parse(text.encode("utf-8", "replace"), True)
    return builder.close()
