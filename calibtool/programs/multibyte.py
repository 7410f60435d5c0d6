"""Multi-byte characters in Latin-1: a byte that looks like a bracket may be half of one."""

import re

_LINE = re.compile(r"[^\r\n]+")
_BYTES = re.compile(r"[\x80-\xff]")
_SHIFT_JIS = r"[\x81-\x9f\xe0-\xfc]", r"[\x40-\x7e\x80-\xfc]", r"|[\xa1-\xdf]"
_GBK = r"[\x81-\xfe]", r"[\x40-\x7e\x80-\xfe]", ""
_CUT = r"(?:(?!\][\s\"])%s|(?=\][\s\"]))"  # the second byte is missing, where a name was too long
_ENCODINGS = (
    *(re.compile(first + second + more) for first, second, more in (_SHIFT_JIS, _GBK)),
    *(re.compile(first + _CUT % second + more) for first, second, more in (_SHIFT_JIS, _GBK)),
    _BYTES,
)


def beyond_ascii_blanked(text: str) -> str:
    """A text in Latin-1, where every byte is a character, with `?` for each byte of a character
    beyond ASCII.

    Positions in the text do not change. UTF-8 is recognised. Among the encodings with two bytes,
    whose second byte may look like ASCII, each line is assumed to be in the first one in which its
    square brackets match.
    """
    if text.isascii():
        return text
    return _LINE.sub(lambda line: line[0] if line[0].isascii() else _blanked(line[0]), text)


def _blanked(line: str) -> str:
    try:
        line.encode("latin-1").decode("utf-8")
    except UnicodeDecodeError:
        pass
    else:
        return _BYTES.sub("?", line)
    readings = [encoding.sub(lambda one: "?" * len(one[0]), line) for encoding in _ENCODINGS]
    whole = [reading for reading in readings if _BYTES.search(reading) is None]
    return next((reading for reading in whole if _in_order(reading)), whole[0])


def _in_order(line: str) -> bool:
    """Whether all square brackets match."""
    depth = 0
    for mark in line:
        depth += (mark == "[") - (mark == "]")
        if depth < 0:
            return False
    return depth == 0
