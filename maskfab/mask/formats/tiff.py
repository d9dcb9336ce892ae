"""TIFF as its bytes say: its tags, which of its values is white, runs of equal bytes; and what OpenImageIO says of it.

TIFF 6.0 requires of every baseline file to say what is white. Readers disagree about files that do not: where
PhotometricInterpretation is missing OpenImageIO takes 0 for black and Pillow for white, and signed samples are black to
one and white to the other. Where 0 is white OpenImageIO turns samples of up to 8 bits, and neither deeper ones nor
floats; opacity is turned with the rest. PackBits (section 9) packs each row of a picture by itself.
"""

from __future__ import annotations

import shutil
import struct
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import SourceError


def said_by(library: Any) -> str:
    """Error message of OpenImageIO or of one of its files; it repeats content of the file, which may be no text."""
    try:
        return str(library.geterror())
    except UnicodeDecodeError:
        return "a name or an entry in it is no text"


_BITS, _PHOTOMETRIC, _SAMPLES, _COLOUR_MAP, _SAMPLE_FORMAT = 258, 262, 277, 320, 339
_MOST_VALUES = {_BITS: 16, _PHOTOMETRIC: 16, _SAMPLES: 16, _COLOUR_MAP: 3 << 8, _SAMPLE_FORMAT: 16}
_CODES = {3: "H", 4: "I", 5: "2I", 6: "b", 8: "h", 9: "i", 10: "2i", 11: "f", 12: "d", 13: "I", 16: "Q", 18: "Q"}
"""Types of numbers, as of :mod:`struct`; others are taken for bytes. Fractions have two."""
_BIG = 43
_LEAST_SAMPLES = {0: 1, 1: 1, 2: 3, 3: 1}
"""Samples per pixel of the interpretations in which white is known: white or black is 0, RGB, a palette."""

_ZERO_IS_WHITE, _ZERO_IS_BLACK, _PALETTE = 0, 1, 3
_UNSIGNED, _FLOAT = 1, 3
_TURNED_BITS = 8
_CURE = "Save it as grey or RGB with a program that writes PhotometricInterpretation, or as PNG"
TURN = "Save it with 0 for black (PhotometricInterpretation = 1) and without opacity, or as PNG"


@dataclass(frozen=True)
class Shown:
    """A TIFF that all readers show alike; ``turned`` if what it holds is the negative of what it says."""

    path: Path
    turned: bool = False

    def positive(self, values: NDArray[Any], white: float) -> NDArray[Any]:
        """Values that were read of it, of which ``white`` is the largest there can be, as the file means them."""
        return np.asarray(white - values, dtype=values.dtype) if self.turned else values


@contextmanager
def shown_alike(path: Path) -> Iterator[Shown]:
    """A TIFF itself, or a copy that all readers show alike.

    Copied is one whose palette is written as bytes times 256, and one of more than 8 bits in which 0 is white.

    Raises:
        SourceError: MF303 if its first directory cannot be read, MF318 if it does not say what is white, or so that
            readers differ.
    """
    with damage_told(path), path.open("rb") as file:
        directory = read_directory(file, header(file.read(16))[2], _MOST_VALUES)
    tags = directory.values
    _check_tone(path, tags)
    if turned := tags[_PHOTOMETRIC] == [_ZERO_IS_WHITE] and max(tags.get(_BITS) or [1]) > _TURNED_BITS:
        tag, numbers = _PHOTOMETRIC, [_ZERO_IS_BLACK]
    else:
        tag, numbers = _COLOUR_MAP, [int(entry) for entry in tags.get(_COLOUR_MAP, [])]
        place = directory.places.get(tag)
        if tags[_PHOTOMETRIC] != [_PALETTE] or place is None or not any(numbers) or any(each & 255 for each in numbers):
            yield Shown(path)
            return
        numbers = [entry | entry >> 8 for entry in numbers[: place.many]]
    start, code, _ = directory.places[tag]
    with copied(path, start, struct.pack(f"{directory.order}{len(numbers)}{code}", *numbers)) as copy:
        yield Shown(copy, turned)


@contextmanager
def copied(path: Path, start: int, content: bytes) -> Iterator[Path]:
    """A copy of a file in which other content stands at one place, until one is done with it."""
    with tempfile.TemporaryDirectory(prefix="maskfab-") as aside:
        copy = Path(aside) / f"copy{path.suffix}"
        shutil.copyfile(path, copy)
        with copy.open("r+b") as file:
            file.seek(start)
            file.write(content)
        yield copy


def _check_tone(path: Path, tags: Tags) -> None:
    """Refuse a TIFF of which readers could show the other tone."""
    stated = tags.get(_PHOTOMETRIC, [])
    if len(stated) != 1:
        what = "does not say" if not stated else "says more than once"
        raise _ambiguous(path, f"{what} whether 0 is black or white: it has {len(stated)} PhotometricInterpretation")
    samples, formats = max(tags.get(_SAMPLES) or [1]), {*tags.get(_SAMPLE_FORMAT, [_UNSIGNED])}
    if stated[0] not in _LEAST_SAMPLES:
        raise _ambiguous(path, f"has PhotometricInterpretation = {stated[0]}, which readers show differently")
    if samples < _LEAST_SAMPLES[int(stated[0])]:
        raise _ambiguous(path, f"has {samples} samples per pixel for PhotometricInterpretation = {stated[0]}")
    if not formats <= {_UNSIGNED, _FLOAT}:
        raise _ambiguous(path, "has signed or undefined samples, whose least is black to some readers only")
    if stated[0] == _ZERO_IS_WHITE and samples > 1:
        what = f"says that 0 is white (PhotometricInterpretation = 0) of {samples} samples per pixel"
        raise _ambiguous(path, what, TURN)


def _ambiguous(path: Path, what: str, cure: str = _CURE) -> SourceError:
    return SourceError("MF318", f"{path.name} {what}", where=str(path), cure=cure)


Tags: TypeAlias = Mapping[int, list[float]]
"""Numbers by tag, whole ones as int, of fractions their quotients; of a tag that is there twice those of both."""


class Place(NamedTuple):
    """Where in a file the first numbers of a tag stand, as of which code of :mod:`struct`, and how many."""

    start: int
    code: str
    many: int


@dataclass(frozen=True)
class Directory:
    """The tags of a directory that matter, in which order of bytes, and where the next one stands; 0 after the last."""

    order: str
    values: Tags
    places: Mapping[int, Place]
    next: int


@contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Refuse as damaged (MF303) a TIFF whose directories, read inside, are none."""
    try:
        yield
    except (struct.error, OSError, ValueError, OverflowError, IndexError, ZeroDivisionError) as error:
        what = f"{path.name}: its first directory is damaged"
        raise SourceError("MF303", what, where=str(path), cure="Write or copy it again") from error


def read_directory(file: BinaryIO, start: int, most_values: Mapping[int, int]) -> Directory:
    """The directory at a place of an open TIFF: of each of the tags named, so many numbers at most.

    Raises:
        struct.error, OSError, ValueError, OverflowError, IndexError, ZeroDivisionError: for a damaged one.
    """
    values: dict[int, list[float]] = {}
    places: dict[int, Place] = {}
    file.seek(0)
    order, big, _ = header(file.read(16))
    file.seek(start)
    count_code, entry, room, word = ("Q", 20, 8, order + "Q") if big else ("H", 12, 4, order + "I")
    (count,) = struct.unpack(order + count_code, file.read(struct.calcsize(count_code)))
    # One by one, for a damaged count may be any number.
    for _ in range(count):
        row, end = file.read(entry), file.tell()
        tag, kind, many = struct.unpack(order + "HH" + word[1], row[:-room])
        if tag not in most_values:
            continue
        code = _CODES.get(kind, "B")
        many = min(many, most_values[tag])
        size = struct.calcsize(order + code) * many
        place = end - room if size <= room else struct.unpack(word, row[-room:])[0]
        file.seek(place)
        numbers = struct.unpack(f"{order}{many * int(code[:-1] or 1)}{code[-1]}", file.read(size))
        file.seek(end)
        if len(code) > 1:
            numbers = tuple(up / down for up, down in zip(numbers[::2], numbers[1::2], strict=True))
        places.setdefault(tag, Place(place, code, many))
        values.setdefault(tag, []).extend(numbers)
    after = file.read(room)
    return Directory(order, values, places, struct.unpack(word, after)[0] if len(after) == room else 0)


def header(start: bytes) -> tuple[str, bool, int]:
    """Order of bytes, whether it is a BigTIFF, and where its first directory stands, of a TIFF's first 16 bytes."""
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
