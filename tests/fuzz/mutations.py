"""Mutations of files: bytes and lines moved, doubled and lost, numbers at the edge, endless
brackets, zeroed sectors.
"""

import io
import random
import re
import zipfile
from collections.abc import Callable, Sequence

NUMBERS = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e999",
        "-0",
        "-0.0",
        "1e308",
        "-1e308",
        "1e-320",
        "0",
        "1",
        "-1",
        "180",
        "1e6",
        "2e9",
    ),
    *(
        "4294967296",
        "9223372036854775808",
        "-9223372036854775809",
        "1_0",
        "0x1f",
        "1,5",
        "٣",
        "½",
        "1e",
        ".",
        "--1",
    ),
    *(
        "9" * 400,
        "9" * 5000,
        "0." + "0" * 400 + "1",
        "true",
        "null",
        "None",
        '"1"',
        "''",
        "[]",
        "{}",
        "1;2",
        "1 2",
    ),
)
WORDS = (
    *(
        "\0",
        "\ufeff",
        "\u2028",
        "é",
        "ß",
        "\U0001f916",
        "\u202e",
        "\r",
        "\n",
        "\r\n",
        "\t",
        "\x0c",
        "\x85",
        "\x1a",
        " ",
    ),
    *(
        '"',
        "'",
        '"""',
        "'''",
        "`",
        "#",
        ";",
        ",",
        ":",
        "=",
        "//",
        "\\",
        "\\u0000",
        "\\",
        "%s",
        "%n",
        "{{",
        "}}",
        "${x}",
    ),
    *(
        "&lt;",
        "&x;",
        "<!--",
        "-->",
        "<![CDATA[",
        "]]>",
        "<?xml?>",
        "../../etc/passwd",
        "/dev/zero",
        "file:///etc/passwd",
    ),
)
OPENING = ("[", "(", "{", "[[", '{"a":', "{a=", "a.", "<a>", "<a><b/>", "- ", "p[", "p{", '"')
_NUMBER = re.compile(rb"[-+]?\d+\.?\d*(?:[eE][-+]?\d+)?")
LONGEST = 1 << 20

Mutation = Callable[[random.Random, bytes, Sequence[bytes]], bytes]


def _span(rng: random.Random, data: bytes, longest: int = 64) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + rng.randrange(1, longest + 1))


def flip(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """Some bits."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8)) if data else 0):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def overwrite(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """Some bytes, by others or by a number at the edge of a binary field."""
    start, end = _span(rng, data, 8)
    new = rng.choice(
        (rng.randbytes(end - start), b"\xff" * (end - start), b"\0" * (end - start), b"\x7f" * 8)
    )
    return data[:start] + new + data[start + len(new) :]


def zero_sector(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """A sector of a disk or a part of one that was never written."""
    size = rng.choice((16, 64, 512, 4096))
    start = rng.randrange(0, max(len(data), 1), size)
    return data[:start] + bytes(min(size, len(data) - start)) + data[start + size :]


def truncate(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """The end is missing, or the beginning."""
    cut = rng.randrange(len(data) + 1)
    return data[:cut] if rng.random() < 0.8 else data[cut:]


def delete(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """A span less."""
    start, end = _span(rng, data)
    return data[:start] + data[end:]


def repeat(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """A span again and again."""
    start, end = _span(rng, data, rng.choice((4, 64)))
    return data[:end] + data[start:end] * rng.choice((1, 1, 2, 20, 2000)) + data[end:]


def splice(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """The beginning of this file and the end of another."""
    other = rng.choice(seeds)
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def number(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """One number, or all of one value, at the edge."""
    found = list(_NUMBER.finditer(data[:200_000]))
    if not found:
        return insert(rng, data, seeds)
    match, new = rng.choice(found), rng.choice(NUMBERS).encode()
    if rng.random() < 0.1:
        return data.replace(match[0], new, 200)
    return data[: match.start()] + new + data[match.end() :]


def insert(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """A word that means something to somebody."""
    start = rng.randrange(len(data) + 1)
    word = rng.choice((rng.choice(WORDS), rng.choice(NUMBERS))).encode()
    return data[:start] + word + data[start:]


def transplant(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """A word of one of the seeds in another place."""
    words = re.findall(rb"\w+|[^\w\s]+", rng.choice(seeds)[:50_000])
    found = list(re.finditer(rb"\w+|[^\w\s]+", data[:50_000]))
    if not words or not found:
        return insert(rng, data, seeds)
    match = rng.choice(found)
    return data[: match.start()] + rng.choice(words) + data[match.end() :]


def lines(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """A line doubled, lost, moved, or taken from another file; other line ends."""
    parts = data.splitlines(keepends=True)
    if not parts:
        return data
    i, j = rng.randrange(len(parts)), rng.randrange(len(parts))
    what = rng.randrange(5)
    if what == 0:
        parts[j:j] = [parts[i]] * rng.choice((1, 1, 3, 500))
    elif what == 1:
        del parts[i]
    elif what == 2:
        parts[i], parts[j] = parts[j], parts[i]
    elif what == 3:
        parts[i:i] = rng.choice(seeds).splitlines(keepends=True)[: rng.randrange(1, 4)]
    else:
        return data.replace(b"\n", rng.choice((b"\r", b"\r\n", b"\n\n", b"", b"\n\r")))
    return b"".join(parts)


def nest(rng: random.Random, data: bytes, seeds: Sequence[bytes]) -> bytes:
    """Brackets that open, and may close."""
    start = rng.randrange(len(data) + 1)
    count = rng.choice((2, 30, 300, 3000, 30_000))
    opened = rng.choice(OPENING)
    closed = {
        "[": "]",
        "(": ")",
        "{": "}",
        '{"a":': "}",
        "{a=": "}",
        "[[": "]]",
        "<a>": "</a>",
    }.get(opened, "")
    return (
        data[:start]
        + (opened * count + "1" + closed * rng.choice((0, count))).encode()
        + data[start:]
    )


TEXT: tuple[Mutation, ...] = (
    *(
        number,
        number,
        number,
        transplant,
        transplant,
        insert,
        insert,
        lines,
        lines,
        delete,
        splice,
        truncate,
        flip,
    ),
    *(repeat, overwrite, nest),
)
BINARY: tuple[Mutation, ...] = (
    flip,
    flip,
    overwrite,
    overwrite,
    zero_sector,
    truncate,
    delete,
    repeat,
    splice,
)


def mutated(
    rng: random.Random, seeds: Sequence[bytes], mutations: Sequence[Mutation], most: int = 3
) -> bytes:
    """One of the seeds after a few mutations."""
    data = rng.choice(seeds)
    for _ in range(rng.randint(1, most)):
        data = rng.choice(mutations)(rng, data, seeds)
    return data[:LONGEST]


def mutated_archive(rng: random.Random, seeds: Sequence[bytes]) -> bytes:
    """A zip archive with mutated text in one of its members, or mutated as it is."""
    if rng.random() < 0.3:
        return mutated(rng, seeds, BINARY)
    archive = zipfile.ZipFile(io.BytesIO(rng.choice(seeds)))
    members = {name: archive.read(name) for name in archive.namelist()}
    chosen = rng.choice(
        [name for name in members if "sheet" in name or "shared" in name or rng.random() < 0.4]
    )
    members[chosen] = mutated(
        rng, list(members.values()) if rng.random() < 0.1 else [members[chosen]], TEXT
    )
    if rng.random() < 0.05:
        del members[rng.choice(list(members))]
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as new:
        for name, data in members.items():
            new.writestr(name, data)
    return out.getvalue()
