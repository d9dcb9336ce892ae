"""A frame: the counts of one exposure as the converter gave them, and what they mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maskfab.base.errors import SourceError

Colour: TypeAlias = Literal["R", "G", "B", "-"]
"""``-`` for a sensor without colours."""
Pattern: TypeAlias = tuple[tuple[Colour, Colour], tuple[Colour, Colour]]
Counts: TypeAlias = NDArray[np.float32]

PIXELS_OF: Mapping[str, str] = MappingProxyType(
    {"R": "red pixels", "G": "green pixels", "B": "blue pixels", "-": "all pixels"}
)
"""Pixels of a colour, in words."""

PLANE_COLOURS: tuple[Colour, Colour, Colour] = ("R", "G", "B")


@dataclass(frozen=True)
class Lattice:
    """Pixels of one colour in a frame.

    Attributes:
        colour: of them.
        channel: of a frame of three planes; None of one that is a mosaic or has no colours.
        first: row and column of the uppermost left one.
        step: rows and columns from one to the next, 1 or 2.
    """

    colour: Colour
    channel: int | None
    first: tuple[int, int]
    step: int

    def of(self, values: NDArray[np.generic]) -> NDArray[np.generic]:
        """Its pixels of an array that is laid out as the frame's counts, as a view."""
        plane = values if self.channel is None else values[self.channel]
        return plane[self.first[0] :: self.step, self.first[1] :: self.step]


@dataclass(frozen=True, eq=False)
class Frame:
    """One exposure.

    Attributes:
        name: of its file.
        counts: float32 [rows, columns], or [3, rows, columns] where all three colours are there at every pixel; row 0
            the top, as the file holds them, not turned.
        black: counts of no light, one for each lattice: those of a mosaic's four places row by row, or of R, G, B.
        white: counts at which a pixel is full; infinite where nothing states it.
        pattern: colours of the mosaic's places, or None.
        exposure_s: in seconds; None where it is not known.
        balance: factors of R, G and B that make white neutral; None where the file has none.
        colour_matrix: float64 [3, 3], from balanced R, G, B to those of linear sRGB; None where the file has none.
        camera: maker and model; empty where the file does not tell.
        sensitivity: ISO speed; None where the file does not tell.
        sha256: of the file; empty without one.
        corner: row and column of the file that is pixel (0, 0) here.
    """

    name: str
    counts: Counts
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

    @property
    def full(self) -> NDArray[np.bool_]:
        """Pixels [rows, columns] that are full in any colour, or beside one that is, across the corner too.

        A full pixel spills over to its neighbours, whatever their colour.
        """
        at_white = np.asarray(self.counts >= np.float32(self.white))
        full = np.asarray(at_white.reshape(-1, *self.shape).any(axis=0))
        return _spread(_spread(full, 0), 1)

    def cropped(self, middle: tuple[int, int], side: int) -> Frame:
        """A square of the frame, its corner on an even row and column so that the mosaic stays as it is.

        Args:
            middle: row and column about which it lies, to within a pixel.
            side: its pixels.

        Raises:
            SourceError: MF337 if it does not lie in the frame.
        """
        top, left = ((at - side // 2) // 2 * 2 for at in middle)
        rows, columns = self.shape
        if side < 1 or top < 0 or left < 0 or top + side > rows or left + side > columns:
            raise SourceError(
                "MF337",
                f"{side} x {side} pixels about row {middle[0]}, column {middle[1]} do not lie in the "
                f"{columns} x {rows} of {self.name}",
                where=self.name,
                cure="Crop fewer pixels, or put the light nearer the middle of the picture",
            )
        part = np.ascontiguousarray(self.counts[..., top : top + side, left : left + side])
        return replace(self, counts=part, corner=(self.corner[0] + top, self.corner[1] + left))


def same_sensor(frames: Sequence[Frame]) -> None:
    """Refuse frames that differ in what their sensor is (MF331).

    Raises:
        SourceError: MF331 with what differs, and the frames that do.
    """
    first = frames[0]
    for each in frames[1:]:
        for what, one, other in (
            ("size", first.counts.shape, each.counts.shape),
            ("place of the crop", first.corner, each.corner),
            ("mosaic", first.pattern, each.pattern),
            ("white level", first.white, each.white),
        ):
            if one != other:
                raise _mixed(first, each, what, one, other)
        for what, known, told in (
            ("camera", first.camera, each.camera),
            ("sensitivity (ISO)", first.sensitivity, each.sensitivity),
        ):
            if known and told and known != told:
                raise _mixed(first, each, what, known, told)


def _mixed(first: Frame, other: Frame, what: str, one: object, two: object) -> SourceError:
    return SourceError(
        "MF331",
        f"{first.name} and {other.name} differ in their {what}: {one} and {two}",
        where=other.name,
        cure="Give frames of one camera at one setting, which differ in their exposure time alone",
    )


def _spread(marked: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    """The marked, and those before and behind them along an axis."""
    found = marked.copy()
    lines, marks = np.moveaxis(found, axis, 0), np.moveaxis(marked, axis, 0)
    lines[1:] |= marks[:-1]
    lines[:-1] |= marks[1:]
    return found
