"""TIFF as its bytes say: which of its values is white, and runs of equal bytes; and what OpenImageIO says of a picture.

TIFF 6.0 requires of every baseline file to say what is white. Readers disagree about files that do not: where
PhotometricInterpretation is missing OpenImageIO takes 0 for black and Pillow for white, and signed samples are black to
one and white to the other. PackBits (section 9) packs each row of a picture by itself.
"""

from __future__ import annotations

import shutil
import struct
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import SourceError


def said_by(library: Any) -> str:
    """Error message of OpenImageIO or of one of its files; it repeats content of the file, which may be no text."""
    try:
        return str(library.geterror())
    except UnicodeDecodeError:
        return "a name or an entry in it is no text"


_PHOTOMETRIC, _SAMPLES, _COLOUR_MAP, _SAMPLE_FORMAT = 262, 277, 320, 339
_MOST_VALUES = {_PHOTOMETRIC: 16, _SAMPLES: 16, _COLOUR_MAP: 3 << 8, _SAMPLE_FORMAT: 16}
_SHORT = 3
_CODES = {_SHORT: "H", 4: "I"}
_BIG = 43
_LEAST_SAMPLES = {0: 1, 1: 1, 2: 3, 3: 1}
"""Samples per pixel of the interpretations in which white is known: white or black is 0, RGB, a palette."""

_PALETTE = 3
_UNSIGNED, _FLOAT = 1, 3
_CURE = "Save it as grey or RGB with a program that writes PhotometricInterpretation, or as PNG"


@contextmanager
def shown_alike(path: Path) -> Iterator[Path]:
    """A TIFF that is shown alike by all readers: itself, or a copy where its palette is written as bytes times 256.

    Raises:
        SourceError: MF303 if its first directory cannot be read, MF318 if it does not say what is white, or so that
            readers differ.
    """
    directory = _directory(path)
    _check_tone(path, directory.values)
    start, count = directory.shorts.get(_COLOUR_MAP, (0, 0))
    entries = directory.values.get(_COLOUR_MAP, [])[:count]
    if directory.values[_PHOTOMETRIC] != [_PALETTE] or not any(entries) or any(entry & 255 for entry in entries):
        yield path
        return
    with tempfile.TemporaryDirectory(prefix="maskfab-") as aside:
        copy = Path(aside) / f"copy{path.suffix}"
        shutil.copyfile(path, copy)
        with copy.open("r+b") as file:
            file.seek(start)
            file.write(struct.pack(f"{directory.order}{count}H", *(entry | entry >> 8 for entry in entries)))
        yield copy


def _check_tone(path: Path, tags: Mapping[int, list[int]]) -> None:
    """Refuse a TIFF of which readers could show the other tone."""
    stated = tags.get(_PHOTOMETRIC, [])
    if len(stated) != 1:
        what = "does not say" if not stated else "says more than once"
        raise _ambiguous(path, f"{what} whether 0 is black or white: it has {len(stated)} PhotometricInterpretation")
    samples, formats = max(tags.get(_SAMPLES) or [1]), {*tags.get(_SAMPLE_FORMAT, [_UNSIGNED])}
    if stated[0] not in _LEAST_SAMPLES:
        raise _ambiguous(path, f"has PhotometricInterpretation = {stated[0]}, which readers show differently")
    if samples < _LEAST_SAMPLES[stated[0]]:
        raise _ambiguous(path, f"has {samples} samples per pixel for PhotometricInterpretation = {stated[0]}")
    if not formats <= {_UNSIGNED, _FLOAT}:
        raise _ambiguous(path, "has signed or undefined samples, whose least is black to some readers only")


def _ambiguous(path: Path, what: str) -> SourceError:
    return SourceError("MF318", f"{path.name} {what}", where=str(path), cure=_CURE)


@dataclass(frozen=True)
class _Directory:
    """The tags of a first directory that matter.

    Attributes:
        order: of bytes, as of :mod:`struct`.
        values: numbers by tag; of one that is there twice those of both.
        shorts: where in the file the first numbers of a tag stand that have no room in its row, and how many they are,
            if they are of two bytes each.
    """

    order: str
    values: Mapping[int, list[int]]
    shorts: Mapping[int, tuple[int, int]]


def _directory(path: Path) -> _Directory:
    values: dict[int, list[int]] = {}
    shorts: dict[int, tuple[int, int]] = {}
    try:
        with path.open("rb") as file:
            order, big, start = _header(file.read(16))
            file.seek(start)
            count_code, entry, room = ("Q", 20, 8) if big else ("H", 12, 4)
            (count,) = struct.unpack(order + count_code, file.read(struct.calcsize(count_code)))
            # One by one, for a damaged count may be any number.
            rows = (file.read(entry) for _ in range(count))
            wanted = [row for row in rows if struct.unpack(order + "H", row[:2])[0] in _MOST_VALUES]
            for row in wanted:
                tag, kind, many = struct.unpack(order + "HH" + ("Q" if big else "I"), row[:-room])
                code = _CODES.get(kind, "B")
                size = struct.calcsize(code) * min(many, _MOST_VALUES[tag])
                held = row[-room:][:size]
                if size > room:
                    (place,) = struct.unpack(order + ("Q" if big else "I"), row[-room:])
                    file.seek(place)
                    held = file.read(size)
                    if kind == _SHORT:
                        shorts.setdefault(tag, (place, size // 2))
                numbers = struct.unpack(f"{order}{size // struct.calcsize(code)}{code}", held)
                values.setdefault(tag, []).extend(numbers)
    except (struct.error, OSError, ValueError, OverflowError, IndexError) as error:
        what = f"{path.name}: its first directory is damaged"
        raise SourceError("MF303", what, where=str(path), cure="Write or copy it again") from error
    return _Directory(order, values, shorts)


def _header(start: bytes) -> tuple[str, bool, int]:
    order = "<" if start.startswith(b"II") else ">"
    (version,) = struct.unpack(order + "H", start[2:4])
    big = version == _BIG
    (offset,) = struct.unpack(order + ("Q" if big else "I"), start[8:16] if big else start[4:8])
    return order, big, int(offset)


_LONGEST = 128
_FEWEST = 3
"""Equal bytes in a row that are shorter told as a run, wherever they stand."""


def pack_bits(row: bytes) -> bytes:
    """One row, which is not empty, in PackBits."""
    values = np.frombuffer(row, dtype=np.uint8)
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    equal = np.diff(starts, append=values.size) >= _FEWEST
    # Neighbours that are no runs are told byte by byte, together.
    begins = np.concatenate([[True], equal[1:] | equal[:-1]])
    starts, equal = starts[begins], equal[begins]
    lengths = np.diff(starts, append=values.size)
    pieces = -(-lengths // _LONGEST)
    owner = np.repeat(np.arange(starts.size), pieces)
    number = np.arange(owner.size) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    begin = starts[owner] + number * _LONGEST
    length = np.minimum(lengths[owner] - number * _LONGEST, _LONGEST)
    run = equal[owner]
    taken = np.where(run, 2, length + 1)
    place = np.cumsum(taken) - taken
    out = np.empty(int(taken.sum()), dtype=np.uint8)
    # A run of one byte, the rest of a longer one, is the same as one byte told by itself.
    out[place] = np.where(run, (257 - length) & 255, length - 1)
    out[place[run] + 1] = values[begin[run]]
    copied: NDArray[np.int64] = length[~run]
    shift = np.repeat(place[~run] + 1 - begin[~run], copied)
    source = np.repeat(begin[~run] - (np.cumsum(copied) - copied), copied) + np.arange(int(copied.sum()))
    out[source + shift] = values[source]
    return out.tobytes()
