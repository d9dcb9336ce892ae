"""The vocabulary: what the machine makes, in the order in which it makes it.

    Opening -> Panel -> Die -> Plate -> (files) -> Psf, Mtf -> Quantity -> Report

Every type is frozen, its arrays are read-only, and it refuses nonsense when it is made, with the code of an
:class:`maskfab.base.errors.InputError`. Arrays are indexed ``[y, x]`` with y upwards: row 0 is the lowest. Integer
nanometres carry geometry, float micrometres carry optics; names end in the unit. What a job states and the optics take
as it is, camera and process, is in :mod:`maskfab.job`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from maskfab.base import checks as require
from maskfab.base.arrays import Floats, Indices, Labels, Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import InternalError

if TYPE_CHECKING:
    from maskfab.base.quantities import Entry

Point = tuple[int, int]
Polygon = tuple[Point, ...]
Box = tuple[int, int, int, int]
Scalar = TypeVar("Scalar", bound=np.generic)

ORIENTATIONS = 8


def orient(cell: NDArray[Scalar], orientation: int) -> NDArray[Scalar]:
    """The cell under one element of D4: mirrored left-right if ``orientation >= 4``, then turned by 90 degrees
    counter-clockwise ``orientation % 4`` times (as seen with y upwards)."""
    mirrored = cell[:, ::-1] if orientation >= 4 else cell
    # np.rot90 turns counter-clockwise for row 0 on top; with row 0 at the bottom the sense is reversed.
    return np.rot90(mirrored, -(orientation % 4))


def refined(cells: NDArray[Scalar], times: int) -> NDArray[Scalar]:
    """The picture [..., y, x] on cells that are finer by a factor along each side."""
    return cells.repeat(times, axis=-2).repeat(times, axis=-1)


def side_by_side(cells: NDArray[Scalar]) -> NDArray[Scalar]:
    """Cells [rows, columns, height, width] as one picture, [rows x height, columns x width]."""
    rows, columns, height, width = cells.shape
    return cells.transpose(0, 2, 1, 3).reshape(rows * height, columns * width)


def split_cells(picture: NDArray[Scalar], height: int, width: int) -> NDArray[Scalar]:
    """The inverse of :func:`side_by_side`: [rows, columns, height, width]."""
    rows, columns = picture.shape[0] // height, picture.shape[1] // width
    return picture.reshape(rows, height, columns, width).transpose(0, 2, 1, 3)


def unit_dots(orientations: Labels, dots: int) -> Indices:
    """Flat index into a unit of every dot of the cells that it is laid out over, [rows x dots, columns x dots]."""
    index = np.arange(dots * dots).reshape(dots, dots)
    return side_by_side(np.stack([orient(index, element) for element in range(ORIENTATIONS)])[orientations])


class Tiling(StrEnum):
    """Rule by which the cells of a panel choose among the eight orientations.

    ``flips`` draws among mirror images only; the two ``rot90`` cycle through four orientations on 2 x 2 cells, the
    second mirrors every other one; ``blue_noise`` is random without coarse clusters; ``hexagonal`` has its cells on a
    hexagonal lattice, each turned by a random multiple of 60 degrees; ``map`` is given cell by cell round the axis, and
    random beyond.
    """

    PERIODIC = "periodic"
    RANDOM = "random"
    PAPER4 = "paper4"
    FLIPS = "flips"
    ROT90 = "rot90"
    ROT90FLIP = "rot90flip"
    BLUE_NOISE = "blue_noise"
    HEXAGONAL = "hexagonal"
    MAP = "map"

    @property
    def seeded(self) -> bool:
        """Whether orientations are drawn, so that a seed is needed."""
        return self not in {Tiling.PERIODIC, Tiling.ROT90, Tiling.ROT90FLIP}

    @property
    def independent(self) -> bool:
        """Whether every cell draws on its own from the same orientations."""
        return self in {Tiling.RANDOM, Tiling.PAPER4, Tiling.FLIPS}


def frozen(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array itself if nobody can write to it, else a read-only copy."""
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


class Frozen:
    """Base of dataclasses whose arrays nobody can write to."""

    def __post_init__(self) -> None:
        for name, value in list(vars(self).items()):
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, frozen(value))


@dataclass(frozen=True, eq=False)
class Opening:
    """The clear shape in one display pixel, on a square grid of dots.

    Attributes:
        name: identifier, also the stem of GDSII cell names.
        mask: bool [dots, dots], True is clear.
        dot_nm: side of one dot at the opening's nominal pitch.
        provenance: who made it, with which command, seed and version.
        emitters: int8 [n, n], n a multiple of dots, the emitters that come with it, labelled as in :class:`Emitters`;
            None where it comes without.
    """

    name: str
    mask: Mask
    dot_nm: int
    provenance: Mapping[str, str | int | float] = field(default_factory=dict)
    emitters: Labels | None = None

    def __post_init__(self) -> None:
        require.instance(self, "name", str)
        require.whole(self, "dot_nm", 1)
        object.__setattr__(self, "mask", frozen(require.square_mask(self, "mask")))
        if self.emitters is not None:
            object.__setattr__(self, "emitters", frozen(_emitter_labels(self, "emitters")))

    @property
    def dots(self) -> int:
        return int(self.mask.shape[0])

    @property
    def cell_size(self) -> CellSize:
        """The cell at the nominal pitch, without a gutter."""
        return CellSize(self.dots, self.dot_nm)

    @property
    def clear_dots(self) -> int:
        return int(self.mask.sum())

    @property
    def open_ratio(self) -> float:
        return self.clear_dots / self.mask.size


COLOURS = ("red", "green", "blue")


@dataclass(frozen=True, eq=False)
class Emitters:
    """The red, green and blue areas of one pixel that emit.

    Attributes:
        labels: int8 [n, n] on square cells that divide the dots, over the pixel less its gutter; 0 is none, 1 to 3 are
            red, green and blue. Turned with the opening.
        cell_nm: side of a cell.
        kept: whether the layout came with the program and was proved again; no search found it.
    """

    labels: Labels
    cell_nm: int
    kept: bool = False

    def __post_init__(self) -> None:
        require.whole(self, "cell_nm", 1)
        object.__setattr__(self, "labels", frozen(_emitter_labels(self, "labels")))

    @property
    def areas_um2(self) -> tuple[float, float, float]:
        """Red, green and blue area."""
        red, green, blue = (float((self.labels == k).sum()) * self.cell_nm**2 / 1e6 for k in (1, 2, 3))
        return red, green, blue


def _emitter_labels(owner: Opening | Emitters, name: str) -> Labels:
    cure = "0 is no emitter, 1 to 3 are red, green and blue, on square cells"
    return require.labels(owner, name, 1 + len(COLOURS), "MF119", cure)


@dataclass(frozen=True)
class Track:
    """Wires of one kind in one pixel.

    Attributes:
        name: scan, data, power ...; what it carries.
        axis: along which it runs; wires along x are on the lower metal, those along y on the upper.
        polygons: simple, hole-free outlines in nanometres, the pixel's lower left corner, gutter included, the origin.
        turns: whether it turns with the opening (drawn for orientation 0), its axis with it, or stays as gutters do.
        transmission: share of light that passes where it crosses an opening; 0 is opaque.
    """

    name: str
    axis: Literal["x", "y"]
    polygons: tuple[Polygon, ...]
    turns: bool
    transmission: float = 0.0

    def __post_init__(self) -> None:
        require.choice(self, "axis", ("x", "y"))
        require.number(self, "transmission", 0.0, 1.0, open_low=False)


@dataclass(frozen=True)
class CircuitBox:
    """A part of a drive circuit, such as a transistor with its contacts, as a rectangle in one pixel.

    Attributes:
        name: of what it holds.
        circuit: number of the circuit in the pixel that it belongs to, from 1.
        box_nm: x0, y0, x1, y1 in the pixel of orientation 0, its lower left corner, gutter included, the origin; it
            turns with the opening.
    """

    name: str
    circuit: int
    box_nm: Box

    @property
    def area_nm2(self) -> int:
        x0, y0, x1, y1 = self.box_nm
        return (x1 - x0) * (y1 - y0)

    @property
    def polygon(self) -> Polygon:
        """Its outline."""
        x0, y0, x1, y1 = self.box_nm
        return (x0, y0), (x1, y0), (x1, y1), (x0, y1)


@dataclass(frozen=True, eq=False)
class Panel:
    """An opening laid out over rows x columns of cells, with an opaque gutter round every cell.

    Attributes:
        dot_nm: side of one dot as laid out.
        gutter_nm: opaque space between the dots of neighbouring cells; half of it on each side of a cell, so even.
        orientations: int8 [rows, columns], what each cell holds: 8 u + k is opening u of ``openings`` under element k
            of D4.
        emitters: what emits behind the opaque part of every pixel; None where nothing is said.
        tracks: wires of every pixel.
        others: further openings among which cells choose, of as many dots as the first.
        circuits: boxes of the drive circuits of every pixel.
    """

    opening: Opening
    dot_nm: int
    gutter_nm: int
    orientations: Labels
    tiling: Tiling
    seed: int | None
    emitters: Emitters | None = None
    tracks: tuple[Track, ...] = ()
    others: tuple[Opening, ...] = ()
    circuits: tuple[CircuitBox, ...] = ()

    def __post_init__(self) -> None:
        require.instance(self, "opening", Opening)
        require.whole(self, "dot_nm", 1)
        require.whole(self, "gutter_nm", 0)
        if self.gutter_nm % 2:
            what = f"{self.gutter_nm} nm is odd, and half of it lies on each side of a cell"
            require.refuse("MF107", self, "gutter_nm", what, f"Use {self.gutter_nm + 1} nm")
        require.instance(self, "tiling", Tiling)
        if self.seed is not None:
            require.whole(self, "seed", 0, 2**63 - 1)
        elif self.tiling.seeded:
            what = f"the {self.tiling} tiling draws its orientations"
            require.refuse("MF111", self, "seed", what, "Give seed = 1, or any other whole number")
        if any(opening.dots != self.opening.dots for opening in self.others):
            what = f"openings of {', '.join(str(opening.dots) for opening in self.openings)} dots in one panel"
            require.refuse("MF122", self, "others", what, "Give openings of as many dots as the first")
        entries = ORIENTATIONS * len(self.openings)
        cure = "A cell holds 8 u + k: opening u under element k of D4"
        object.__setattr__(self, "orientations", frozen(require.labels(self, "orientations", entries, "MF122", cure)))

    @property
    def openings(self) -> tuple[Opening, ...]:
        return self.opening, *self.others

    @property
    def common(self) -> Opening:
        """Union of its openings, of which emitters that are alike in all cells keep clear."""
        if not self.others:
            return self.opening
        return replace(self.opening, mask=np.any([opening.mask for opening in self.openings], axis=0))

    def pattern(self, cell: int) -> Mask:
        """Contents of a cell, bool [dots, dots], from its entry in ``orientations``."""
        return orient(self.openings[cell // ORIENTATIONS].mask, cell % ORIENTATIONS)

    @property
    def patterns(self) -> Mask:
        """Everything that a cell can hold, bool [8 openings, dots, dots]."""
        return np.stack([self.pattern(cell) for cell in range(ORIENTATIONS * len(self.openings))])

    @property
    def cell_size(self) -> CellSize:
        return CellSize(self.opening.dots, self.dot_nm, self.gutter_nm)

    @property
    def pitch_nm(self) -> int:
        return self.cell_size.pitch_nm

    @property
    def size_nm(self) -> Point:
        rows, columns = self.orientations.shape
        return columns * self.pitch_nm, rows * self.pitch_nm

    @property
    def open_ratio(self) -> float:
        """Share of a cell, gutter included, that is clear; the mean over all cells if they hold several openings."""
        if not self.others:
            return self.opening.clear_dots * self.dot_nm**2 / self.pitch_nm**2
        held = np.bincount(self.orientations.ravel() // ORIENTATIONS, minlength=len(self.openings))
        clear = sum(float(n) * opening.clear_dots for n, opening in zip(held, self.openings, strict=True))
        return clear / self.orientations.size * self.dot_nm**2 / self.pitch_nm**2


@dataclass(frozen=True, eq=False)
class Die:
    """One panel on a plate, centred in a square slot.

    Attributes:
        name: unique on the plate; letters, digits and underscores.
        label: text drawn in clear under the die.
        centre_nm: centre of the slot in plate coordinates (plate centre = origin).
        slot_nm: side of the square slot; the panel is not larger.
    """

    name: str
    label: str
    panel: Panel
    centre_nm: Point
    slot_nm: int

    def __post_init__(self) -> None:
        require.instance(self, "name", str)
        require.instance(self, "panel", Panel)
        for value in self.centre_nm:
            require.whole(self, "centre_nm", -require.MOST_NM, value=value)
        require.whole(self, "slot_nm", 1)
        if max(self.panel.size_nm) > self.slot_nm:
            width, height = self.panel.size_nm
            what = f"a panel of {width} x {height} nm is larger than its slot of {self.slot_nm} nm"
            require.refuse("MF108", self, "slot_nm", what, "Use fewer cells or a larger slot")

    @property
    def origin_nm(self) -> Point:
        """Lower left corner of the panel."""
        width, height = self.panel.size_nm
        return self.centre_nm[0] - width // 2, self.centre_nm[1] - height // 2

    @property
    def box_nm(self) -> Box:
        """Panel's bounding box: x0, y0, x1, y1."""
        (x, y), (width, height) = self.origin_nm, self.panel.size_nm
        return x, y, x + width, y + height


@dataclass(frozen=True)
class Layer:
    """A layer of the plate under its names in each format.

    Attributes:
        name: DXF layer name (at most 8 characters).
        written: whether the mask writer exposes it (digitized data = clear).
    """

    name: str
    number: int
    datatype: int
    written: bool
    purpose: str


CLEAR = Layer("CLEAR", 1, 0, True, "everything that is clear in the chrome: openings, labels, marks")
CHROME = Layer("CHROME", 3, 0, True, "all chrome of the writable area: drawn in place of CLEAR where data are dark")
OUTLINE = Layer("OUTLINE", 10, 0, False, "blank, writable area and die slots, for orientation only")
NOTE = Layer("NOTE", 11, 0, False, "version, job hash and seeds as text, for orientation only")
EMITTERS = (
    Layer("RED", 20, 0, False, "red emitters of the display; not on the mask"),
    Layer("GREEN", 21, 0, False, "green emitters of the display; not on the mask"),
    Layer("BLUE", 22, 0, False, "blue emitters of the display; not on the mask"),
)
WIRES = (
    Layer("WIRE1", 30, 0, False, "wires of the display's lower metal; not on the mask"),
    Layer("WIRE2", 31, 0, False, "wires of the display's upper metal; not on the mask"),
)
VEIL = Layer("VEIL", 32, 0, False, "transparent wires of the display; not on the mask")
CIRCUIT = Layer("CIRCUIT", 33, 0, False, "boxes of the display's drive circuits; not on the mask")
GUTTER = Layer("GUTTER", 40, 0, False, "space for wires round every pixel; not on the mask")
BLACK = Layer("BLACK", 41, 0, False, "black matrix: neither clear nor emitting; not on the mask")
LAYERS = (CLEAR, OUTLINE, NOTE, *EMITTERS, *WIRES, VEIL, CIRCUIT, GUTTER, BLACK)


@dataclass(frozen=True)
class Mark:
    """A mark of the plate that is not a panel.

    Attributes:
        kind: title, label, fiducial, alignment (cross), parity, cd (bars), resolution (test figures), map (of dies),
            code (data matrix), outline (of dies, or of what a drawing spans), or wires across a die.
        polygons: simple, hole-free outlines in plate coordinates, nanometres.
    """

    name: str
    kind: Literal[
        "title", "label", "fiducial", "alignment", "parity", "cd", "resolution", "map", "code", "outline", "wires"
    ]
    layer: Layer
    polygons: tuple[Polygon, ...]


@dataclass(frozen=True)
class Gauge:
    """A straight probe across one clear feature; its critical dimension is the clear length along the probe.

    Attributes:
        name: identifier in the CD table.
        reach_nm: half the probe's length; wider than the feature and short of its neighbours.
        target_nm: the drawn width.
    """

    name: str
    axis: Literal["x", "y"]
    centre_nm: Point
    reach_nm: int
    target_nm: int

    def __post_init__(self) -> None:
        require.choice(self, "axis", ("x", "y"))
        require.whole(self, "reach_nm", 1)
        require.whole(self, "target_nm", 0)


@dataclass(frozen=True)
class Note:
    """Text for people who open the file, on the NOTE layer; never written on the plate."""

    text: str
    position_nm: Point


@dataclass(frozen=True)
class Snapping:
    """Movement of a plate's marks to the grid of its data.

    Attributes:
        grid_nm: of which every written vertex is a multiple.
        vertices: that were moved.
        farthest_nm: distance that none was moved beyond.
    """

    grid_nm: int
    vertices: int
    farthest_nm: float

    def __str__(self) -> str:
        return (
            f"{self.vertices} vertices of marks moved by at most {self.farthest_nm:.3g} nm to the data grid of "
            f"{self.grid_nm} nm"
        )


@dataclass(frozen=True, eq=False)
class Plate:
    """A photomask: blank, dies, marks, and the gauges at which its CDs are measured. Origin: the blank's centre.

    ``snapped`` is None where the grid of its data is 1 nm; ``texts`` stand in the title after its maker, by key.
    """

    name: str
    title: str
    blank_nm: int
    writable_nm: int
    dies: tuple[Die, ...]
    marks: tuple[Mark, ...]
    gauges: tuple[Gauge, ...]
    notes: tuple[Note, ...]
    snapped: Snapping | None = None
    texts: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require.instance(self, "name", str)
        require.whole(self, "blank_nm", 1)
        require.whole(self, "writable_nm", 1)
        names = [die.name for die in self.dies]
        if len(set(names)) < len(names):
            what = f"two dies are called {next(name for name in names if names.count(name) > 1)!r}"
            require.refuse("MF109", self, "dies", what, "Give each die a name of its own")


@dataclass(frozen=True, eq=False)
class Psf(Frozen):
    """Intensity per square micrometre of sensor, so that the whole plane holds 1.

    Attributes:
        values: float64 [n, n], n odd, the optical axis on the middle sample.
        kind: ``point`` samples the intensity, ``pixel`` is its mean over square pixels of side ``step_um``.
    """

    values: Floats
    step_um: float
    wavelength_nm: float
    kind: Literal["point", "pixel"]

    @property
    def energy_in_window(self) -> float:
        """Share of all transmitted energy that falls inside the window (midpoint rule if ``point``)."""
        return float(self.values.sum() * self.step_um**2)


@dataclass(frozen=True, eq=False)
class RadialMean(Frozen):
    """Mean of an MTF over all directions at radii about those at which it falls below levels of interest.

    Attributes:
        error: float64 [n], bound of the error of each, and of a straight line between them.
    """

    frequency_cy_per_mm: Floats
    modulation: Floats
    error: Floats


@dataclass(frozen=True, eq=False)
class Mtf:
    """Presampled modulation transfer (optics x sensor pixel) from 0 to half a cycle per pixel.

    Attributes:
        frequency_cy_per_mm: float64 [n], 0 first.
        cuts: float64 [n] each, by name: horizontal, vertical, diagonal (+45), antidiagonal (-45), radial_mean,
            radial_min, radial_max.
        wavelength_nm: the line it was computed at.
        uncertainty: bound on the absolute error of any sample.
        minimum_uncertainty: bound on the error of the radial minimum's mean over all frequencies.
        falls: the radial mean where it falls.
    """

    frequency_cy_per_mm: Floats
    cuts: Mapping[str, Floats]
    wavelength_nm: float
    uncertainty: float
    minimum_uncertainty: float
    falls: RadialMean


@dataclass(frozen=True)
class Quantity:
    """One reported number: a row of report.json, whose words are in :mod:`maskfab.base.quantities`.

    Attributes:
        name: registered there, which also gives symbol and unit.
        uncertainty: half width of the error bar, in ``unit``; None where the value is exact.
        limit: what ``passed`` was judged against; None where nothing is required.
        level_db: light that it holds for, as the signal-to-noise ratio of white behind the published display.
        at_most: whether the value is a bound that the truth may lie far below.
        between: edges of a band.
        detail: what completes a symbol or unit that differs from row to row, such as ``6 um`` in ``SE(6 um)``.
    """

    name: str
    value: float | int | str | None
    method: str
    uncertainty: float | None = None
    limit: float | int | str | None = None
    passed: bool | None = None
    die: str | None = None
    wavelength_nm: float | None = None
    level_db: float | None = None
    at_most: bool = False
    between: tuple[float, float] | None = None
    detail: str | None = None

    def __post_init__(self) -> None:
        if self._entry.takes_detail != (self.detail is not None):
            raise InternalError("MF901", f"symbol or unit of {self.name!r} cannot be told with detail {self.detail!r}")

    @property
    def _entry(self) -> Entry:
        from maskfab.base.quantities import registered  # reads a long table, and a panel needs none

        return registered(self.name)

    @property
    def symbol(self) -> str:
        """Symbol of the formula; empty for counts and words."""
        return self._entry.symbol.replace("{detail}", self.detail or "")

    @property
    def unit(self) -> str:
        """Unit of value, uncertainty and limit; ``1`` for a ratio, empty for counts and words."""
        return self._entry.unit.replace("{detail}", self.detail or "")

    def __float__(self) -> float:
        if not isinstance(self.value, int | float):
            raise TypeError(f"{self.name} = {self.value!r} is no number")
        return float(self.value)

    def __str__(self) -> str:
        """Value, error bar and unit; the value to one digit more than the error bar leaves."""
        value, error = self.value, ""
        if isinstance(value, float):
            half = self.uncertainty or 0.0
            digits = math.ceil(math.log10(abs(value) / half)) + 1 if half and value else 6
            value = f"{value:.{min(max(digits, 3), 9)}g}"
            error = f"± {half:.1g}" if half else ""
        parts = ("≤" if self.at_most else "", "none" if value is None else str(value), error, self.unit.strip("1"))
        return " ".join(part for part in parts if part)


@dataclass(frozen=True, eq=False)
class DieOptics:
    """Optics of one die, computed from the polygons read back from the file."""

    die: Die
    psfs: tuple[Psf, ...]
    mtfs: tuple[Mtf, ...]
    quantities: tuple[Quantity, ...]


@dataclass(frozen=True)
class WrittenFile:
    """A file of the output directory, by its path relative to it."""

    path: str
    format: str
    bytes: int
    sha256: str


@dataclass(frozen=True, eq=False)
class Report:
    """The content of report.json.

    Attributes:
        seeds: seed of every random tiling, by die.
        dies: quantities by die name, in plate order.
        checks: every quantity that was judged, of dies and plate alike.
        seconds: wall-clock time by stage; the only content that differs between equal runs.
    """

    title: str
    job_hash: str
    seeds: Mapping[str, int]
    dies: Mapping[str, tuple[Quantity, ...]]
    plate: tuple[Quantity, ...]
    checks: tuple[Quantity, ...]
    files: tuple[WrittenFile, ...]
    seconds: Mapping[str, float]

    @property
    def passed(self) -> bool:
        return all(check.passed for check in self.checks)
