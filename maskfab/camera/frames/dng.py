"""A DNG by its own tags: where its active pixels lie, their black, white, mosaic and tone, beside what LibRaw reads.

LibRaw scales floating-point counts by the brightest of them and takes one black a colour, whatever the tags say.
Here the tags are read a second time, and the pixels by libtiff (in OpenImageIO) wherever it knows their packing: the
two must agree, or the file is refused.

Formulas are those of the Digital Negative specification 1.7, chapter 5 (mapping raw values to linear reference values):
black is told relative to the active area, as a pattern that repeats plus one delta a row and one a column; what is
above it is divided by white less the *largest* black. Counts are therefore shifted, each pixel's by the largest black
less its own, so that one black holds for all and every share of white is the specification's.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.base.errors import SourceError
from maskfab.camera.frames.frame import MOST_PIXELS, PLANE_COLOURS, Colour, Frame, Pattern
from maskfab.mask.formats.tiff import Tags, copied, damage_told, header, read_directory, said_by

_KIND, _WIDTH, _HEIGHT, _BITS, _PACKING, _PHOTOMETRIC, _SAMPLES, _SUBS, _FORMAT = (
    254, 256, 257, 258, 259, 262, 277, 330, 339,
)  # fmt: skip
_CFA_SIZE, _CFA, _VERSION, _CFA_LAYOUT = 33421, 33422, 50706, 50711
_TABLE, _REPEAT, _BLACK, _ACROSS, _DOWN, _WHITE, _ACTIVE = 50712, 50713, 50714, 50715, 50716, 50717, 50829
_LISTS = (51008, 51009)
_MOST = MappingProxyType(
    {
        **dict.fromkeys((_KIND, _WIDTH, _HEIGHT, _PACKING, _PHOTOMETRIC, _SAMPLES, _CFA_LAYOUT), 1),
        **dict.fromkeys((_BITS, _FORMAT, _CFA_SIZE, _VERSION, _REPEAT, _ACTIVE, _WHITE), 4),
        **dict.fromkeys((_SUBS, _CFA), 64),
        **dict.fromkeys((_TABLE, _ACROSS, _DOWN), 1 << 16),
        **dict.fromkeys(_LISTS, 1 << 20),
        _BLACK: 1 << 12,
    }
)
"""Tags that are read, and how many numbers of each."""

_MOST_DIRECTORIES = 32
_MOSAIC, _PLANES = 32803, 34892
_JPEG = 7
_LOSSY = MappingProxyType({34892: "JPEG", 52546: "JPEG XL"})
_JPEG_BITS = 8
_READ_TWICE = (1, 5, 8, 32773, 32946)
"""Packings that libtiff reads, too: none, LZW, Deflate, PackBits."""

_FLOATING = 3
_TONES = MappingProxyType(
    {
        7: "MapTable",
        8: "MapPolynomial",
        10: "DeltaPerRow",
        11: "DeltaPerColumn",
        12: "ScalePerRow",
        13: "ScalePerColumn",
    }
)
"""Operations on the counts themselves; the rest mend pixels, shading and distortion, which no capture needs."""

_LINEAR = "Convert it to uncompressed DNG of whole counts, or save it as linear TIFF of 16 bits"


@dataclass(frozen=True)
class Told:
    """The raw picture of a DNG as its tags tell of it.

    Attributes:
        start: where in the file its directory stands.
        active: top, left, bottom and right of the pixels that see light.
    """

    start: int
    tags: Tags
    active: tuple[int, int, int, int]

    def one(self, tag: int, otherwise: int) -> int:
        return int((self.tags.get(tag) or [otherwise])[0])

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns, masked ones too."""
        return self.one(_HEIGHT, 0), self.one(_WIDTH, 0)

    @property
    def floating(self) -> bool:
        return self.one(_FORMAT, 1) == _FLOATING

    @property
    def white(self) -> float:
        """Count of a full pixel."""
        return float(self.one(_WHITE, 1 if self.floating else (1 << self.one(_BITS, 16)) - 1))

    def black(self) -> Singles:
        """Counts of no light, float32 [rows, columns, planes] of the active pixels, or what broadcasts to it."""
        rows, columns = (int(side) for side in self.tags.get(_REPEAT) or (1, 1))
        planes = self.one(_SAMPLES, 1)
        levels = np.asarray(self.tags.get(_BLACK) or [0.0], np.float32)
        if levels.size == 1:
            levels = np.full(rows * columns * planes, levels[0])
        top, left, bottom, right = self.active
        tall, wide = bottom - top, right - left
        pattern = levels.reshape(rows, columns, planes)
        times = (1, 1, 1) if rows == columns == 1 else (-(-tall // rows), -(-wide // columns), 1)
        black = np.tile(pattern, times)[:tall, :wide]
        for tag, axes in ((_DOWN, (1, 2)), (_ACROSS, (0, 2))):
            if tag in self.tags:
                black = black + np.expand_dims(np.asarray(self.tags[tag], np.float32), axes)
        return np.asarray(black)


def told(path: Path) -> Told | None:
    """The raw picture of a DNG as its tags tell; None of another file.

    Raises:
        SourceError: MF303 for damaged tags, MF308 for planes of unlike white, MF330 for compression with loss or a tone
            that LibRaw leaves out.
    """
    with path.open("rb") as file:
        start = file.read(16)
    if start[:4] not in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return None
    with damage_told(path):
        found = _raw(path, header(start)[2])
        if found is None:
            return None
        place, tags = found
        height, width = (int((tags.get(tag) or [0])[0]) for tag in (_HEIGHT, _WIDTH))
        top, left, bottom, right = (int(side) for side in tags.get(_ACTIVE) or (0, 0, height, width))
        raw = Told(place, tags, (top, left, bottom, right))
        repeat = math.prod(int(side) for side in tags.get(_REPEAT) or (1, 1))
        if not (0 <= top < bottom <= height and 0 <= left < right <= width and height * width <= MOST_PIXELS):
            raise ValueError
        if not (0 < repeat * raw.one(_SAMPLES, 1) <= _MOST[_BLACK] and np.isfinite(raw.black()).all()):
            raise ValueError
    packing = raw.one(_PACKING, 1)
    if packing in _LOSSY or (packing == _JPEG and raw.one(_BITS, 16) <= _JPEG_BITS):
        what = f"{path.name} is compressed with loss (Compression = {packing}, {_LOSSY.get(packing, 'JPEG')})"
        raise SourceError("MF330", what, where=str(path), cure=_LINEAR)
    if len(whites := set(tags.get(_WHITE, []))) > 1:
        what = (
            f"{path.name} has a white of its own in each plane: {', '.join(f'{white:g}' for white in sorted(whites))}"
        )
        raise SourceError("MF308", what, where=str(path), cure=_LINEAR)
    for name in _tones(tags):
        what = f"{path.name} maps its counts by {name}, an operation of its OpcodeList that is not done here"
        raise SourceError("MF330", what, where=str(path), cure=_LINEAR)
    return raw


def _raw(path: Path, first: int) -> tuple[int, Tags] | None:
    """Place and tags of the full raw picture of a DNG."""
    places, version, found = [first], False, []
    with path.open("rb") as file:
        for number, place in enumerate(places):  # which grows as directories tell of others
            directory = read_directory(file, place, _MOST)
            tags = directory.values
            version = version or (number == 0 and _VERSION in tags)
            if (tags.get(_PHOTOMETRIC) or [0])[0] in (_MOSAIC, _PLANES) and not (tags.get(_KIND) or [0])[0]:
                found.append((place, tags))
            others = [*map(int, tags.get(_SUBS) or ()), directory.next]
            places += [other for other in others if other and other not in places][: _MOST_DIRECTORIES - len(places)]
    return found[0] if version and found else None


def _tones(tags: Tags) -> list[str]:
    names = []
    for each in _LISTS:
        content = bytes(int(byte) for byte in tags.get(each) or ())
        (count,) = struct.unpack(">I", content[:4] or bytes(4))
        at = 4
        for _ in range(count):
            if at + 16 > len(content):
                break
            number, _version, optional, size = struct.unpack(">4I", content[at : at + 16])
            if number in _TONES and not optional & 1:
                names.append(_TONES[number])
            at += 16 + size
    return names


def as_told(frame: Frame, counted: NDArray[Any], corner: tuple[int, int], raw: Told, path: Path) -> Frame:
    """A frame of LibRaw's with the pixels, levels and mosaic that the tags tell.

    Args:
        counted: all of LibRaw's counts, [rows, columns] or [rows, columns, planes], masked ones too.
        corner: row and column of all counts that LibRaw takes for the first that see light.

    Raises:
        SourceError: MF308 where pixels or mosaic are read otherwise by LibRaw, or cannot be read a second time.
    """
    if counted.shape[:2] != raw.shape:
        raise _disagree(path, "rows and columns", raw.shape, counted.shape[:2])
    counted = counted.reshape(*raw.shape, -1)[:, :, : raw.one(_SAMPLES, 1)]  # a fourth plane is LibRaw's own
    again = _again(path, raw)
    if raw.floating and again is None:
        what = f"{path.name} holds floating-point counts in a packing ({raw.one(_PACKING, 1)}) that only LibRaw reads"
        raise SourceError("MF308", what, where=str(path), cure=_LINEAR)
    if again is not None and not raw.floating and not np.array_equal(again, counted):
        row, column, plane = (int(place[0]) for place in np.nonzero(again != counted))
        one, two = again[row, column, plane], counted[row, column, plane]
        raise _disagree(path, f"the count of row {row}, column {column}", one, two)
    top, left, bottom, right = raw.active
    pixels = counted if again is None else again
    black = raw.black()
    most = black.max(axis=(0, 1))  # of each plane; a mosaic is one
    light = pixels[top:bottom, left:right].astype(np.float32) - (black - most)
    if not np.isfinite(light).all():
        raise SourceError("MF303", f"{path.name} has counts that are not finite", where=str(path), cure=_LINEAR)
    planes = light.transpose(2, 0, 1)
    counts = np.ascontiguousarray(planes[0] if len(planes) == 1 else planes)
    pattern = None if frame.pattern is None else _pattern(raw, path)
    if pattern is not None:
        y, x = (at - first for at, first in zip(corner, raw.active, strict=False))
        there = tuple(tuple(pattern[(y + row) % 2][(x + column) % 2] for column in (0, 1)) for row in (0, 1))
        if there != frame.pattern:
            raise _disagree(path, f"the mosaic from row {corner[0]}, column {corner[1]} on", there, frame.pattern)
    read = replace(frame, counts=counts, white=raw.white, pattern=pattern)
    levels = most.tolist()
    return replace(read, black=tuple(levels if len(levels) == len(read.lattices) else levels * len(read.lattices)))


def _pattern(raw: Told, path: Path) -> Pattern:
    """Colours of 2 x 2 pixels from the corner of the active area on, to which they are told."""
    size, places, layout = raw.tags.get(_CFA_SIZE), raw.tags.get(_CFA) or [], raw.one(_CFA_LAYOUT, 1)
    named: list[Colour] = [PLANE_COLOURS[int(place)] for place in places if place < len(PLANE_COLOURS)]
    if layout != 1 or size != [2, 2] or sorted(named) != ["B", "G", "G", "R"]:
        what = f"{path.name} tells of a mosaic of {size} pixels, {places}, which LibRaw reads as red, green and blue"
        raise SourceError("MF308", what, where=str(path), cure=_LINEAR)
    one, two, three, four = named
    return (one, two), (three, four)


def _again(path: Path, raw: Told) -> NDArray[Any] | None:
    """All its pixels by libtiff, [rows, columns, planes], their table of tones applied; None where it does not know."""
    import OpenImageIO as oiio  # noqa: N813 - its customary name

    if raw.one(_PACKING, 1) not in _READ_TWICE:
        return None
    with path.open("rb") as file:
        order, big, _ = header(file.read(16))
    first = struct.pack(order + ("Q" if big else "I"), raw.start)  # the first picture alone is seen
    with copied(path, 8 if big else 4, first) as copy:
        image = oiio.ImageInput.open(str(copy))
        if image is None:
            said_by(oiio)
            return None
        spec = image.spec()
        pixels = image.read_image("float" if raw.floating else "uint16")
        problem = said_by(image) or said_by(oiio)
        image.close()
    if pixels is None or problem or (spec.height, spec.width) != raw.shape:
        return None
    values = np.asarray(pixels).reshape(*raw.shape, -1)
    if raw.floating:
        return np.asarray(values)
    # Counts of fewer bits it stretches to 16.
    counts = np.rint(values * ((1 << raw.one(_BITS, 16)) - 1.0) / 65535).astype(np.intp)
    table = np.asarray(raw.tags.get(_TABLE) or (), np.intp)
    return np.asarray(table[np.minimum(counts, table.size - 1)] if table.size else counts)


def _disagree(path: Path, what: str, told: object, read: object) -> SourceError:
    said = f"{path.name}: its readers disagree about {what}: {told} by its tags and libtiff, {read} by LibRaw"
    return SourceError("MF308", said, where=str(path), cure=_LINEAR)
