"""A format of files as a type: what each module of :mod:`maskfab.mask.formats` says of its own, in one place.

A module lists its formats as ``FORMATS``, and :mod:`maskfab.mask.formats.table` gathers them under the names that a job
may give. Here is also what writers and comparisons are given: settings, the drawn plate, and the file of a result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

from maskfab.base.errors import OutputError
from maskfab.base.model import Box, Die, Plate, Point, Quantity
from maskfab.base.units import NM_PER_MM, NM_PER_UM, UM_PER_NM

if TYPE_CHECKING:
    from klayout import db

    from maskfab.job.values import FileFormat
    from maskfab.mask.figures import Figures
    from maskfab.mask.formats.solid import Mesh

Version: TypeAlias = Literal["R12", "R2010"]
"""Of DXF."""

UNITS = {"um": (NM_PER_UM, "MICROMETRE", 13), "mm": (NM_PER_MM, "MILLIMETRE", 4)}
"""Nanometres, name and $INSUNITS of a drawing's unit."""

_NARROWEST_CORNER_NM, _CORNER_SHARE, _WIDEST_CORNER_SHARE = 10.0, 0.1, 2 / 3
"""Of a gap or neck at a corner: what float32 millimetres keep apart, and shares of a dot, by default and at most."""


@dataclass(frozen=True)
class Stack:
    """Thicknesses of a mask.

    Attributes:
        exaggeration: factor on the film's thickness, for viewers that cannot show 100 nm; files say so.
        corners: what openings that touch by a corner get in a mesh: a gap of chrome between them, or a neck that joins
            them. No closed surface has a corner of no width.
        corner_nm: width of that; a tenth of a dot if None.
    """

    chrome_nm: float = 100.0
    glass_nm: float = 2_300_000.0
    exaggeration: float = 1.0
    corners: Literal["gap", "neck"] = "gap"
    corner_nm: float | None = None

    @property
    def film_nm(self) -> float:
        """Thickness of the film as drawn, from -film/2 to film/2; the glass lies below it."""
        return self.chrome_nm * self.exaggeration

    def corner_leg_nm(self, die: Die) -> int:
        """Distance from a corner that touches to where its gap or neck ends on the sides of the openings.

        Raises:
            OutputError: MF436 for a gap or neck below 10 nm, or above two thirds of a dot, which would meet the next.
        """
        dot_nm = die.panel.dot_nm
        width = _CORNER_SHARE * dot_nm if self.corner_nm is None else self.corner_nm
        widest = math.floor(_WIDEST_CORNER_SHARE * dot_nm)
        if not _NARROWEST_CORNER_NM <= width <= widest:
            what = (
                f"openings touch by a corner, and a {self.corners} of {width:g} nm there is not within "
                f"{_NARROWEST_CORNER_NM:g} nm and {widest} nm, two thirds of a dot"
            )
            cure = "State one that is, or leave glb, 3mf and stl out of export.formats"
            raise OutputError("MF436", what, where=f"die {die.name}", cure=cure)
        return round(width / math.sqrt(2))

    def touching_remark(self, die: Die, touches: int) -> tuple[str, ...]:
        """Remark of a mesh about so many corners that touched."""
        if not touches:
            return ()
        width_um = self.corner_leg_nm(die) * math.sqrt(2) * UM_PER_NM
        return (f"{touches} touching corners have a {self.corners} of {width_um:.3g} um",)

    def remarks(self) -> tuple[str, ...]:
        """Remarks of a file about its thicknesses."""
        said = f"chrome {self.chrome_nm:g} nm on {self.glass_nm / 1e6:g} mm of glass"
        return (said,) if self.exaggeration == 1 else (said, f"film drawn {self.exaggeration:g} times too thick")


Films: TypeAlias = "Callable[[Die, Stack], tuple[Mesh, int]]"
"""The film of a die as a closed surface, and how many of its corners touched."""


@dataclass(frozen=True)
class DrawingStyle:
    """Requirements of a shop for a drawing beyond its polygons.

    Attributes:
        layer_names: names in the file by names of the model; layers without one are left out. All by default.
        unit_text: versions in which a line of text names the unit as well.
        frame_nm: box to which text and the header's extents keep, in plate coordinates; the blank by default.
    """

    layer_names: Mapping[str, str] | None = None
    unit: Literal["um", "mm"] = "um"
    unit_text: tuple[Version, ...] = ("R12", "R2010")
    frame_nm: Box | None = None

    @property
    def unit_name(self) -> str:
        """In small letters."""
        return UNITS[self.unit][1].lower()

    def length(self, nm: int) -> float:
        """In the drawing's unit."""
        return nm / UNITS[self.unit][0]

    def point(self, point_nm: Point) -> tuple[float, float]:
        """In the drawing's unit."""
        return self.length(point_nm[0]), self.length(point_nm[1])


@dataclass(frozen=True)
class FileSettings:
    """Settings of the writers beyond a plate's figures: dots per inch if needed; names of DXF's layers also OASIS's."""

    stack: Stack = field(default_factory=Stack)
    stl_limit_bytes: int = 100_000_000
    dots_per_um: float = 0.125
    dpi: int | None = None
    drawing: DrawingStyle = field(default_factory=DrawingStyle)


@dataclass(frozen=True, eq=False)
class Source:
    """A plate as it is drawn, which its files are written from; ``films`` makes the film of a die of meshes."""

    figures: Figures
    comments: Sequence[str]
    settings: FileSettings
    films: Films

    @property
    def plate(self) -> Plate:
        """The plate that was drawn."""
        return self.figures.plate

    @property
    def dpi(self) -> int:
        """Dots per inch, which whoever asks for such a format has stated."""
        assert self.settings.dpi is not None
        return self.settings.dpi


class Drawn(Protocol):
    """A plate, its design, and how its files were drawn: what they are held against."""

    @property
    def plate(self) -> Plate:
        """The plate."""

    @property
    def design(self) -> db.Layout:
        """The plate as :func:`maskfab.mask.layout.plate_layout` builds it."""

    @property
    def figures(self) -> Figures:
        """Cells and polygons, as writers draw them."""

    @property
    def settings(self) -> FileSettings:
        """Settings of the writers."""


@dataclass(frozen=True, eq=False)
class Format:
    """A format of files, and all that is known of it.

    Attributes:
        write_plate: writes a file of the whole plate; None where there is none.
        write_die: the same of one die, for a file of each.
        compare_plate: rows that hold a file of the plate against it; None where the polygons of ``read`` are compared.
        compare_die: the same of one die.
        read: a file as a layout, by a library that did not write it, within the limits of
            :func:`maskfab.mask.layout.check_limits`; of a format that takes a unit (um) as its second argument.
        readers: packages that read it, each with what it reads alone, in its own unit; the first finds what is damaged.
        agreed: whether ``read`` refuses what these draw otherwise, but for the chords of each.
        suffixes: of files that are read whoever wrote them.
        layers: whether layers have numbers, only names, or a file is one layer: what the writer exposes, no more.
        notes: whether notes stand in it as text that readers can see as such.
        takes_unit: whether a file may not say its unit, so that it can be stated.
        extra: whose packages write it or read it back; None where every installation can.
        loads: of these packages, compiled modules that load libraries of the system.
        reading: how files are best read beside others: here, in a thread, for it takes long in a process of its own, or
            in a fork of this process, which it keeps busy.
    """

    name: FileFormat
    title: str
    tail: str
    write_plate: Callable[[Source, Path], object] | None = None
    write_die: Callable[[Source, Die, Path], object] | None = None
    compare_plate: Callable[[Drawn, Path], tuple[Quantity, ...]] | None = None
    compare_die: Callable[[Drawn, Die, Path], tuple[Quantity, ...]] | None = None
    read: Callable[..., db.Layout] | None = None
    readers: tuple[tuple[str, Callable[..., db.Layout]], ...] = ()
    agreed: bool = False
    suffixes: tuple[str, ...] = ()
    layers: Literal["numbered", "named", "one"] = "numbered"
    notes: bool = False
    takes_unit: bool = False
    extra: Literal["solid", "gerber"] | None = None
    loads: tuple[str, ...] = ()
    reading: Literal["here", "thread", "fork"] = "here"


@dataclass(frozen=True, eq=False)
class Product:
    """One file of a result, about one die, or (None) the whole plate."""

    name: str
    form: Format
    write: Callable[[Path], object]
    die: Die | None = None

    @property
    def polygons(self) -> bool:
        """Whether it is a layout, whose polygons are compared with the design's."""
        return self.form.read is not None
