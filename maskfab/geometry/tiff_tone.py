"""Tone of a TIFF: which of its values is white, as TIFF 6.0 requires of every baseline file.

Readers disagree about files that do not: where PhotometricInterpretation is missing OpenImageIO takes 0 for black and
Pillow for white, and signed samples are black to one and white to the other.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path

from maskfab.errors import SourceError

_PHOTOMETRIC, _SAMPLES, _SAMPLE_FORMAT = 262, 277, 339
_WANTED = frozenset({_PHOTOMETRIC, _SAMPLES, _SAMPLE_FORMAT})
_CODES = {3: "H", 4: "I"}
_MOST_VALUES = 16
_BIG = 43
_LEAST_SAMPLES = {0: 1, 1: 1, 2: 3, 3: 1}
"""Samples per pixel of the interpretations in which white is known: white or black is 0, RGB, a palette."""

_UNSIGNED, _FLOAT = 1, 3
_CURE = "Save it as grey or RGB with a program that writes PhotometricInterpretation, or as PNG"


def check_tiff_tone(path: Path) -> None:
    """Refuse a TIFF of which readers could show the other tone.

    Raises:
        SourceError: MF303 if its first directory cannot be read, MF318 if it does not say what is white, or so that
            readers differ.
    """
    tags = _tags(path)
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


def _tags(path: Path) -> Mapping[int, list[int]]:
    """The numbers of the tags that matter in the first directory; of one that is there twice those of both."""
    found: dict[int, list[int]] = {}
    try:
        with path.open("rb") as file:
            order, big, start = _header(file.read(16))
            file.seek(start)
            count_code, entry, room = ("Q", 20, 8) if big else ("H", 12, 4)
            (count,) = struct.unpack(order + count_code, file.read(struct.calcsize(count_code)))
            # One by one, for a damaged count may be any number.
            rows = (file.read(entry) for _ in range(count))
            wanted = [row for row in rows if struct.unpack(order + "H", row[:2])[0] in _WANTED]
            for row in wanted:
                tag, kind, many = struct.unpack(order + "HH" + ("Q" if big else "I"), row[:-room])
                code = _CODES.get(kind, "B")
                size = struct.calcsize(code) * min(many, _MOST_VALUES)
                values = row[-room:][:size]
                if size > room:
                    file.seek(*struct.unpack(order + ("Q" if big else "I"), row[-room:]))
                    values = file.read(size)
                found.setdefault(tag, []).extend(struct.unpack(f"{order}{size // struct.calcsize(code)}{code}", values))
    except (struct.error, OSError, ValueError, OverflowError, IndexError) as error:
        raise SourceError(
            "MF303", f"{path.name}: its first directory is damaged", where=str(path), cure="Write or copy it again"
        ) from error
    return found


def _header(start: bytes) -> tuple[str, bool, int]:
    """Order of bytes, whether it is a BigTIFF, and where the first directory stands."""
    order = "<" if start.startswith(b"II") else ">"
    (version,) = struct.unpack(order + "H", start[2:4])
    big = version == _BIG
    (offset,) = struct.unpack(order + ("Q" if big else "I"), start[8:16] if big else start[4:8])
    return order, big, int(offset)
