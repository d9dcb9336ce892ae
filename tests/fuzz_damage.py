"""Ways to damage a file: blindly byte by byte, and by its grammar, so that it still passes for its format."""

from __future__ import annotations

import io
import random
import re
import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path

Damage = Callable[[bytes, random.Random], bytes]

NUMBERS = (
    "0", "1", "-1", "2", "7", "9", "0.5", "-0", "1e-9", "1e308", "nan", "inf", ".", "-", "4294967296", "-2147483648",
    "99999999999999999999", "90", "45", "0x10", "1_0",
)  # fmt: skip
DIGIT = re.compile(rb"[0-9\xb2\xb3\xb9]")
"""What is a digit in Latin-1."""

WHOLE = (0, 1, -1, 2, 3, 90, 255, 256, 1000, 2**15 - 1, -(2**15), 2**31 - 1, -(2**31))


def damaged(data: bytes, suffix: str, chance: random.Random) -> bytes:
    """The bytes with one to sixteen damages, half of them by the grammar of files that end in ``suffix``."""
    ways = GRAMMARS.get(suffix, ())
    for _ in range(chance.choice([1, 1, 1, 2, 4, 16])):
        if len(data) < 2:
            break
        data = chance.choice(ways if ways and chance.random() < 0.5 else BLIND)(data, chance)
    return data


# --- blindly ---------------------------------------------------------------------------------------------------------


def _put(data: bytes, place: int, new: bytes, old: int) -> bytes:
    return data[:place] + new + data[place + old :]


def flip(data: bytes, chance: random.Random) -> bytes:
    place = chance.randrange(len(data))
    return _put(data, place, bytes([data[place] ^ 1 << chance.randrange(8)]), 1)


def byte(data: bytes, chance: random.Random) -> bytes:
    value = chance.choice([0, 1, 0x7F, 0x80, 0xFF, chance.randrange(256)])
    return _put(data, chance.randrange(len(data)), bytes([value]), 1)


def truncate(data: bytes, chance: random.Random) -> bytes:
    return data[: chance.randrange(1, len(data))]


def splice(data: bytes, chance: random.Random) -> bytes:
    start, place = chance.randrange(len(data)), chance.randrange(len(data))
    size = chance.choice([1, 2, 4, 16, 64, 512])
    return _put(data, place, data[start : start + size], size)


def repeat(data: bytes, chance: random.Random) -> bytes:
    start = chance.randrange(len(data))
    return _put(data, start, data[start : start + chance.choice([1, 4, 32, 256])] * chance.choice([1, 2, 50]), 0)


def cut(data: bytes, chance: random.Random) -> bytes:
    return _put(data, chance.randrange(len(data)), b"", chance.choice([1, 2, 4, 32, 256]))


def length(data: bytes, chance: random.Random) -> bytes:
    """Overwrite what may be a length or a count with a small or a huge one."""
    size = chance.choice([1, 2, 4, 8])
    value = chance.choice([0, 1, 2, 2 ** (8 * size - 1) - 1, 2 ** (8 * size - 1), 2 ** (8 * size) - 1])
    return _put(data, chance.randrange(len(data)), value.to_bytes(size, chance.choice(["big", "little"])), size)


def digit(data: bytes, chance: random.Random) -> bytes:
    places = [place for place in (chance.randrange(len(data)) for _ in range(40)) if chr(data[place]).isdigit()]
    return _put(data, places[0], chance.choice(NUMBERS).encode(), 1) if places else data


BLIND: tuple[Damage, ...] = (flip, byte, truncate, splice, repeat, cut, length, digit)


# --- by grammar ------------------------------------------------------------------------------------------------------


def shuffled(parts: Sequence[bytes], chance: random.Random) -> list[bytes]:
    """A part dropped, doubled, moved or replaced by another."""
    parts = list(parts)
    one, other = chance.randrange(len(parts)), chance.randrange(len(parts))
    match chance.randrange(5):
        case 0:
            del parts[one]
        case 1:
            parts.insert(other, parts[one])
        case 2:
            parts[one], parts[other] = parts[other], parts[one]
        case 3:
            parts[one] = parts[other]
        case _:
            del parts[min(one, other) : min(one, other) + chance.choice([2, 5, 20])]
    return parts


def lines(data: bytes, chance: random.Random) -> bytes:
    return b"".join(shuffled(data.splitlines(keepends=True), chance))


def number(data: bytes, chance: random.Random) -> bytes:
    """A whole number of a text, with its sign and its point, replaced."""
    words = data.split(b"\n")
    holding = [place for place, word in enumerate(words) if DIGIT.search(word)]
    if not holding:
        return data
    place = chance.choice(holding)
    word = words[place]
    start = chance.choice([each.start() for each in DIGIT.finditer(word)])
    end = start
    while start and chr(word[start - 1]) in "0123456789.-":
        start -= 1
    while end < len(word) and chr(word[end]) in "0123456789.":
        end += 1
    words[place] = word[:start] + chance.choice(NUMBERS).encode() + word[end:]
    return b"\n".join(words)


def pairs(data: bytes, chance: random.Random) -> bytes:
    """Group codes of a DXF stay with their values."""
    rows = data.splitlines(keepends=True)
    return b"".join(shuffled([b"".join(rows[k : k + 2]) for k in range(0, len(rows), 2)], chance))


def records(data: bytes, chance: random.Random) -> bytes:
    """Records of a GDSII moved about, or a number of one changed."""
    parts, place = [], 0
    while place + 4 <= len(data):
        size = max(4, int.from_bytes(data[place : place + 2], "big"))
        parts.append(data[place : place + size])
        place += size
    if not parts or chance.random() < 0.4:
        return b"".join(shuffled(parts, chance)) + data[place:] if parts else data
    which = chance.choice([k for k, part in enumerate(parts) if len(part) > 4] or [0])
    part = parts[which]
    size, form = {2: (2, ">h"), 3: (4, ">i"), 5: (8, ">Q")}.get(part[3], (1, ">b"))
    if len(part) < 4 + size:
        return data
    at = 4 + size * chance.randrange((len(part) - 4) // size)
    value = chance.choice(WHOLE)
    if size == 4:
        value = chance.choice([value, struct.unpack_from(form, part, at)[0] + chance.choice([-8000, -1, 1, 8000])])
    bits = 8 * size
    value = (value + 2 ** (bits - 1)) % 2**bits - 2 ** (bits - 1) if form != ">Q" else value % 2**bits
    parts[which] = _put(part, at, struct.pack(form, value), size)
    return b"".join(parts) + data[place:]


def chunks(data: bytes, chance: random.Random) -> bytes:
    """Chunks of a PNG moved about or changed inside, with check sums that hold."""
    parts, place = [], 8
    while place + 12 <= len(data):
        size = int.from_bytes(data[place : place + 4], "big")
        parts.append(data[place : place + 12 + size])
        place += 12 + size
    if not parts or chance.random() < 0.3:
        return data[:8] + b"".join(shuffled(parts, chance)) if parts else data
    which = chance.randrange(len(parts))
    kind, inside = parts[which][4:8], parts[which][8:-4]
    if kind == b"IDAT" and chance.random() < 0.7:
        try:
            inside = zlib.compress(chance.choice(BLIND)(zlib.decompress(inside), chance))
        except zlib.error:
            return data
    elif inside:
        inside = chance.choice([flip, byte, length])(inside, chance)
    body = kind + inside
    parts[which] = len(inside).to_bytes(4, "big") + body + zlib.crc32(body).to_bytes(4, "big")
    return data[:8] + b"".join(parts)


def tags(data: bytes, chance: random.Random) -> bytes:
    """An entry of a TIFF's first directory changed."""
    order = "<" if data[:2] == b"II" else ">"
    if len(data) < 8:
        return data
    start = int(struct.unpack_from(order + "I", data, 4)[0])
    if start + 2 > len(data):
        return data
    entries = int(struct.unpack_from(order + "H", data, start)[0])
    at = start + 2 + 12 * chance.randrange(max(1, entries))
    size, offset = chance.choice([(2, 0), (2, 2), (4, 4), (4, 8), (2, 8)])
    if at + 12 > len(data):
        return data
    value = chance.choice(WHOLE) % 2 ** (8 * size)
    return _put(data, at + offset, value.to_bytes(size, "little" if order == "<" else "big"), size)


def members(data: bytes, chance: random.Random) -> bytes:
    """Members of a zip renamed, dropped, doubled or damaged, in a zip whose own sums hold."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            held = [(info.filename, archive.read(info)) for info in archive.infolist()]
    except Exception:  # damaged before: whatever it is that zipfile says of it
        return data
    if not held:
        return data
    which = chance.randrange(len(held))
    name, content = held[which]
    match chance.randrange(5):
        case 0:
            name = chance.choice(
                ["../out.txt", "/out.txt", "a/b/c", "C:\\out", name.upper(), name + "\0", "", "x/", "."]
            )
        case 1:
            del held[which]
        case 2:
            held.insert(chance.randrange(len(held)), (Path(name).parent.name + "/more.txt", content))
        case 3 if content:
            suffix = Path(name).suffix
            content = chance.choice((*BLIND, *GRAMMARS.get(suffix, ())))(content, chance)
        case _:
            content = b""
    held = [(name, content) if k == which else each for k, each in enumerate(held)]
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        for each, inside in dict(held).items():
            archive.writestr(zipfile.ZipInfo(each), inside)
    return whole.getvalue()


GRAMMARS: dict[str, tuple[Damage, ...]] = {
    ".gds": (records,),
    ".dxf": (pairs, lines, number),
    ".gbr": (lines, number),
    ".toml": (lines, number),
    ".txt": (lines,),
    ".json": (number,),
    ".npy": (number,),
    ".png": (chunks,),
    ".tif": (tags,),
    ".zip": (members,),
    ".3mf": (members,),
    ".svg": (lines, number),
    ".step": (lines, number),
    ".model": (lines, number),
}
