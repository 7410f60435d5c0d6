"""Bytes of a text file → text: UTF-8 and UTF-16 by their marks, or encodings of spreadsheets."""

import codecs
import re

from calibtool.errors import InputError, UsageError

_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
# Windows, DOS, old Macs; the first unless the contents fit another one better
_EIGHT_BIT = (
    "cp1252",
    "cp850",
    "mac_roman",
)
_SIGN = re.compile(r"(?<![^\W\d_])[°µ²³](?=[^\wà-ÿ]|[cCFKmM]?\b|$)")
_BEGINNING = 4000  # number of bytes in which zeros show UTF-16 without a mark


def decoded(data: bytes, name: str, encoding: str | None = None) -> tuple[str, str | None]:
    """The text, and its encoding where it was neither stated nor Unicode.

    Raises UsageError for an unknown encoding, InputError for bytes that are not valid in the stated
    one.
    """
    if encoding is not None:
        try:
            return data.decode(codecs.lookup(encoding).name), None
        except LookupError:
            raise UsageError(
                f"--encoding {encoding}: unknown; expected utf-8, utf-16, cp1252, latin-1, cp850 …"
            ) from None
        except UnicodeDecodeError as error:
            raise InputError(f"{name}: not {encoding} (byte {error.start + 1})") from None
    for mark, unicode in _MARKS:
        if data.startswith(mark):
            return _strict(data, name, unicode), None
    if (unmarked := _without_mark(data)) is not None:
        return _strict(data, name, unmarked), None
    try:
        return data.decode("utf-8"), None
    except UnicodeDecodeError as error:
        if b"\0" in data:
            raise InputError(
                f"{name}: not a text file (byte {error.start + 1}); save it as UTF-8 or export it "
                "as CSV"
            ) from None
    found = [(candidate, data.decode(candidate, "replace")) for candidate in _EIGHT_BIT]
    best = max(found, key=lambda item: len(_SIGN.findall(item[1])) - 10 * item[1].count("\ufffd"))
    return best[1], best[0]


def _strict(data: bytes, name: str, encoding: str) -> str:
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{name}: not a {encoding.upper()} text file (byte {error.start + 1}); save it as "
            "UTF-8 or export it as CSV"
        ) from None


def _without_mark(data: bytes) -> str | None:
    """UTF-16 without a byte order mark: every other byte of its beginning is zero."""
    part = data[:_BEGINNING]
    if len(part) < 20:
        return None
    for start, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
        zeros, others = part[start::2].count(0), part[1 - start :: 2].count(0)
        if zeros > 0.8 * (len(part) // 2) and not others:
            return encoding
    return None
