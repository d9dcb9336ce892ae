"""A frame: the counts of one exposure as the converter gave them, what they mean, and how they are read.

RAW is read by LibRaw (extra ``raw``), linear TIFF and PNG of 16 bits and EXR by OpenImageIO, in a process of its own.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import SourceError
from maskfab.base.extras import require
from maskfab.base.files import no_file
from maskfab.base.provenance import sha256_of_file
from maskfab.mask.sandbox import PATIENCE_S, read_apart

Colour: TypeAlias = Literal["R", "G", "B", "-"]
"""``-`` for a sensor without colours."""
Pattern: TypeAlias = tuple[tuple[Colour, Colour], tuple[Colour, Colour]]

PIXELS_OF: Mapping[str, str] = MappingProxyType(
    {"R": "red pixels", "G": "green pixels", "B": "blue pixels", "-": "all pixels"}
)
"""Pixels of a colour, in words."""

PLANE_COLOURS: tuple[Colour, Colour, Colour] = ("R", "G", "B")


@dataclass(frozen=True)
class Lattice:
    """Pixels of one colour in a frame.

    Attributes:
        channel: of a frame of three planes; None of one that is a mosaic or has no colours.
        step: rows and columns from one to the next, 1 or 2.
    """

    colour: Colour
    channel: int | None
    first: tuple[int, int]
    step: int

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """Its pixels of an array that is laid out as the frame's counts, as a view."""
        return self.at(values if self.channel is None else values[self.channel])

    def at(self, values: NDArray[Any]) -> NDArray[Any]:
        """Its pixels of an array [..., rows, columns] of any content, as a view."""
        return values[..., self.first[0] :: self.step, self.first[1] :: self.step]


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure.

    Attributes:
        counts: float32 [rows, columns], or [3, rows, columns] where all three colours are there at every pixel; row 0
            the top, as the file holds them, not turned.
        black: counts of no light, one for each lattice: those of a mosaic's four places row by row, or of R, G, B.
        white: counts at which a pixel is full; infinite where nothing states it.
        balance: factors of R, G and B that make white neutral.
        colour_matrix: float64 [3, 3], from balanced R, G, B to those of linear sRGB; None where the file has none.
        corner: row and column of the file that is pixel (0, 0) here.
        orientation: tag of TIFF and EXIF that says how the file is to be turned to be seen, which its counts are not.
    """

    name: str
    counts: Singles
    black: tuple[float, ...]
    white: float
    pattern: Pattern | None = None
    exposure_s: float | None = None
    balance: tuple[float, float, float] | None = None
    colour_matrix: NDArray[np.float64] | None = None
    camera: str = ""
    sensitivity: float | None = None
    sha256: str = ""
    corner: tuple[int, int] = (0, 0)
    orientation: int = 1

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.counts.shape[-2:]
        return rows, columns

    @property
    def lattices(self) -> tuple[Lattice, ...]:
        """Its colours, in the order of :attr:`black`: R, G, G, B of a mosaic in the order of its places."""
        if self.counts.ndim == 3:
            return tuple(Lattice(colour, channel, (0, 0), 1) for channel, colour in enumerate(PLANE_COLOURS))
        if self.pattern is None:
            return (Lattice("-", None, (0, 0), 1),)
        return tuple(Lattice(self.pattern[y][x], None, (y, x), 2) for y in (0, 1) for x in (0, 1))

    def signal(self, place: int) -> Floats:
        """Counts above black of one of its lattices."""
        return np.asarray(self.lattices[place].of(self.counts).astype(np.float64) - self.black[place])

    @property
    def whole(self) -> bool:
        """Whether a converter rounded to whole counts."""
        return bool((self.counts == np.rint(self.counts)).all())

    @property
    def full(self) -> NDArray[np.bool_]:
        """Pixels [rows, columns] full in any colour, or beside such, across corners too: full pixels spill over."""
        at_white = np.asarray(self.counts >= np.float32(self.white))
        full = np.pad(at_white.reshape(-1, *self.shape).any(axis=0), 1)
        rows = full[:-2] | full[1:-1] | full[2:]
        return np.asarray(rows[:, :-2] | rows[:, 1:-1] | rows[:, 2:])

    def cropped(self, middle: tuple[int, int], side: int) -> Frame:
        """A square of the frame (MF337), its corner on an even row and column so that the mosaic stays as it is."""
        top, left = ((at - side // 2) // 2 * 2 for at in middle)
        rows, columns = self.shape
        if side < 1 or top < 0 or left < 0 or top + side > rows or left + side > columns:
            what = (
                f"{side} x {side} pixels about row {middle[0]}, column {middle[1]} do not lie in the "
                f"{columns} x {rows} of {self.name}"
            )
            cure = "Crop fewer pixels, or put the light nearer the middle of the picture"
            raise SourceError("MF337", what, where=self.name, cure=cure)
        part = np.ascontiguousarray(self.counts[..., top : top + side, left : left + side])
        return replace(self, counts=part, corner=(self.corner[0] + top, self.corner[1] + left))


def same_sensor(frames: Sequence[Frame]) -> None:
    """Refuse frames that differ in what their sensor is (MF331)."""
    first = frames[0]
    for other in frames[1:]:
        for what, one, two in (
            ("size", first.counts.shape, other.counts.shape),
            ("place of the crop", first.corner, other.corner),
            ("mosaic", first.pattern, other.pattern),
            ("white level", first.white, other.white),
            # Files may tell nothing of these.
            ("camera", first.camera or other.camera, other.camera or first.camera),
            ("sensitivity (ISO)", first.sensitivity or other.sensitivity, other.sensitivity or first.sensitivity),
        ):
            if one != two:
                raise SourceError(
                    "MF331",
                    f"{first.name} and {other.name} differ in their {what}: {one} and {two}",
                    where=other.name,
                    cure="Give frames of one camera at one setting, which differ in their exposure time alone",
                )


_CODED = (".jpg", ".jpeg", ".heic", ".heif", ".avif", ".webp", ".gif", ".bmp", ".hdr", ".jxl")


_MOSAICS: dict[str, Pattern] = {
    "rggb": (("R", "G"), ("G", "B")),
    "bggr": (("B", "G"), ("G", "R")),
    "grbg": (("G", "R"), ("B", "G")),
    "gbrg": (("G", "B"), ("R", "G")),
}


MOST_PIXELS = 120_000_000
"""Of a frame; medium format has a hundred million."""

PICTURES = (".tif", ".tiff", ".png", ".exr")


Source: TypeAlias = Path | Frame
"""A file, or a frame in memory, of which nothing is stated yet."""


OF_BYTES, LEVELS_OF_BYTES = 257, 16
"""Step of 8 bits stretched to 16, and how many of its levels prove it."""


def white_of_16_bits(values: NDArray[Any]) -> float:
    """The largest number of 16 bits that a converter of fewer bits writes, whose levels were shifted upwards.

    Few levels may have a step in common by chance.
    """
    used = int(np.bitwise_or.reduce(values, axis=None)) if values.size else 1
    step = used & -used or 1
    if step > 1 and len(np.unique(values)) <= LEVELS_OF_BYTES:
        step = 1
    return float(np.iinfo(np.uint16).max // step * step)


def frame_of_array(given: ArrayLike, name: str) -> Frame:
    """A frame of counts in memory, or of light: linear, row 0 the top.

    Args:
        given: [rows, columns], [rows, columns, 3] or [3, rows, columns], whole numbers of 16 bits or more, or floats;
            white is 65535 of uint16, or the last level of fewer bits that were shifted; unknown of others, black 0.

    Raises:
        SourceError: MF330 for 8 bits, stretched ones too, which are codes of a display; MF331 for another shape, or
            none; MF333 for what is
            no number, or not finite.
    """
    values = np.asarray(given)
    planes = values.transpose(2, 0, 1) if values.ndim == 3 and values.shape[2] == 3 else values
    if not planes.size or planes.ndim not in (2, 3) or (planes.ndim == 3 and len(planes) != 3):
        what = f"an array of shape {values.shape} is no frame"
        raise SourceError("MF331", what, where=name, cure="Give [rows, columns], or [rows, columns, 3]")
    if values.dtype in (np.uint8, np.int8, np.bool_):
        what = f"an array of {values.dtype} holds codes of a picture, not light"
        cure = "Give linear light, as uint16 or as float, or the path of the picture"
        raise SourceError("MF330", what, where=name, cure=cure)
    if values.dtype == np.uint16 and not (values % OF_BYTES).any() and len(np.unique(values)) > LEVELS_OF_BYTES:
        what = f"an array of uint16 holds 8 bits as 16: all its values are multiples of {OF_BYTES}"
        raise SourceError("MF330", what, where=name, cure="Give linear light with the steps of the camera's converter")
    if values.dtype.kind not in "uif" or not np.isfinite(values).all():
        what = f"an array of {values.dtype}" if values.dtype.kind not in "uif" else "an array with values not finite"
        raise SourceError("MF333", f"{what} is no frame", where=name, cure="Give finite real numbers")
    counts = np.ascontiguousarray(planes, dtype=np.float32)
    white = white_of_16_bits(values) if values.dtype == np.uint16 else math.inf
    sha256 = hashlib.sha256(counts.tobytes()).hexdigest()
    return Frame(name, counts, (0.0,) * (3 if counts.ndim == 3 else 1), white, sha256=sha256)


def read_frame(
    path: Source,
    *,
    exposure_s: float | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
) -> Frame:
    """One frame, a file in a process of its own.

    Args:
        path: ``.tif .tiff .png .exr``; anything else is taken for RAW. Or a frame in memory.
        black: counts of no light in every colour; what the file states, or 0, if None.
        white: counts of a full pixel; what the file states, the last level of 16 bits or infinite if None.
        mosaic: ``rggb bggr grbg gbrg`` of a picture that holds a mosaic in grey.

    Raises:
        SourceError: MF301 missing, MF302 empty, MF303 damaged, MF308 of a kind that is not read, MF313 too large, MF316
            far slower to read than frames are, MF318 a TIFF that does not say what is white, MF330 not linear, MF333
            black not below white or an exposure that is not above 0.
        JobError: MF152 for RAW without rawpy.
    """
    where = path.name if isinstance(path, Frame) else str(path)
    frame = path if isinstance(path, Frame) else _read(Path(path), where)
    frame = replace(frame, pattern=_stated_mosaic(frame, mosaic, where))
    levels, count = frame.black if black is None else (black,), len(frame.lattices)
    frame = replace(
        frame,
        exposure_s=frame.exposure_s if exposure_s is None else exposure_s,
        black=levels if len(levels) == count else levels[:1] * count,
        white=frame.white if white is None else white,
    )
    _check_levels(frame, where)
    return frame


def _read(path: Path, where: str) -> Frame:
    if not os.path.isfile(path):
        raise SourceError("MF301", no_file(path, path.name), where=where, cure="Give the path of a frame")
    if path.stat().st_size == 0:
        raise SourceError("MF302", f"{path.name} holds 0 bytes", where=where, cure="Copy it from the camera again")
    suffix = path.suffix.lower()
    if suffix in _CODED:
        what = f"{path.name} is a {suffix[1:].upper()} picture, of 8 bits or compressed with loss, not linear counts"
        cure = "Give the camera's RAW file, or linear TIFF or PNG of 16 bits, or EXR"
        raise SourceError("MF330", what, where=where, cure=cure)
    if suffix not in PICTURES:
        require("raw", what=f"the RAW file {path.name}", where=where, otherwise="save it as linear TIFF of 16 bits")
    frame: Frame = read_apart(path, Path(__file__).with_name("frame_process.py"), kind=Frame, seconds=PATIENCE_S)
    return replace(frame, sha256=sha256_of_file(path))


def read_frames(
    paths: Sequence[Source],
    *,
    times_s: Sequence[float] | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
) -> tuple[Frame, ...]:
    """Frames of one sensor.

    Args:
        times_s: an exposure for each file, in their order; what the files state if None.

    Raises:
        SourceError: as :func:`read_frame`; MF331 if they are not of one sensor, MF332 if there are not as many times as
            files.
    """
    if times_s is not None and len(times_s) != len(paths):
        what = f"{len(times_s)} exposure times are given for {len(paths)} files"
        raise SourceError("MF332", what, cure="Give one time for each file, in the same order")
    times: Sequence[float | None] = [None] * len(paths) if times_s is None else times_s
    frames = tuple(
        read_frame(path, exposure_s=time, black=black, white=white, mosaic=mosaic)
        for path, time in zip(paths, times, strict=True)
    )
    same_sensor(frames)
    return frames


def _stated_mosaic(frame: Frame, mosaic: str | None, where: str) -> Pattern | None:
    if mosaic is None:
        return frame.pattern
    pattern = _MOSAICS.get(mosaic.lower())
    if pattern is None or frame.counts.ndim != 2:
        what = f"{mosaic!r} is no mosaic" if pattern is None else f"{frame.name} has three planes, which are no mosaic"
        raise SourceError("MF331", what, where=where, cure=f"State one of {', '.join(_MOSAICS)}, of grey pictures only")
    if frame.pattern is not None and frame.pattern != pattern:
        what = f"{frame.name} says that its mosaic is {letters(frame.pattern).lower()}, not {mosaic.lower()}"
        raise SourceError("MF331", what, where=where, cure="Leave the mosaic out")
    return pattern


def letters(pattern: Pattern) -> str:
    """Colours of a mosaic's places row by row, such as ``RGGB``."""
    return "".join(colour for row in pattern for colour in row)


def _check_levels(frame: Frame, where: str) -> None:
    if not (max(frame.black) < frame.white and all(map(math.isfinite, frame.black))):
        what = f"black of {max(frame.black):g} counts is not below white of {frame.white:g}"
        raise SourceError("MF333", what, where=where, cure="State black and white in the counts of the file")
    if frame.exposure_s is not None and not (math.isfinite(frame.exposure_s) and frame.exposure_s > 0):
        what = f"an exposure of {frame.exposure_s:g} s is not above 0"
        raise SourceError("MF332", what, where=where, cure="Give a positive time for each file")
