"""The vocabulary: what the machine makes, in the order in which it makes it.

    Opening -> Panel -> Die -> Plate -> (files) -> Psf, Mtf -> Quantity -> Report

Every type is frozen and its arrays are read-only. Arrays are indexed ``[y, x]`` with y upwards: row 0 is the
lowest. Integer nanometres carry geometry, float micrometres carry optics; names end in the unit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

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


class Tiling(StrEnum):
    """How the cells of a panel choose among the eight orientations."""

    PERIODIC = "periodic"
    RANDOM = "random"
    PAPER4 = "paper4"


@dataclass(frozen=True, eq=False)
class Opening:
    """The clear shape in one display pixel, on a square grid of dots.

    Attributes:
        name: identifier, also the stem of GDSII cell names.
        mask: bool [dots, dots], True is clear.
        dot_nm: side of one dot at the opening's nominal pitch.
        provenance: who made it, with which command, seed and version.
    """

    name: str
    mask: NDArray[np.bool_]
    dot_nm: int
    provenance: Mapping[str, str | int | float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "mask", frozen(np.asarray(self.mask, dtype=np.bool_)))

    @property
    def dots(self) -> int:
        return int(self.mask.shape[0])

    @property
    def clear_dots(self) -> int:
        return int(self.mask.sum())

    @property
    def open_ratio(self) -> float:
        return self.clear_dots / self.mask.size


@dataclass(frozen=True, eq=False)
class Panel:
    """An opening laid out over rows x columns of cells, with an opaque gutter round every cell.

    Attributes:
        opening: the unit opening.
        dot_nm: side of one dot as laid out.
        gutter_nm: opaque space between the dots of neighbouring cells; half of it on each side of a cell, so even.
        orientations: int8 [rows, columns], an element of D4 for each cell.
        tiling: how the orientations were chosen.
        seed: seed of a random tiling.
    """

    opening: Opening
    dot_nm: int
    gutter_nm: int
    orientations: NDArray[np.int8]
    tiling: Tiling
    seed: int | None

    def __post_init__(self) -> None:
        object.__setattr__(self, "orientations", frozen(np.asarray(self.orientations, dtype=np.int8)))

    @property
    def pitch_nm(self) -> int:
        return self.opening.dots * self.dot_nm + self.gutter_nm

    @property
    def size_nm(self) -> Point:
        rows, columns = self.orientations.shape
        return columns * self.pitch_nm, rows * self.pitch_nm

    @property
    def open_ratio(self) -> float:
        """Share of a cell, gutter included, that is clear."""
        return self.opening.clear_dots * self.dot_nm**2 / self.pitch_nm**2


@dataclass(frozen=True, eq=False)
class Die:
    """One panel on a plate, centred in a square slot.

    Attributes:
        name: unique on the plate; letters, digits and underscores.
        label: text drawn in clear under the die.
        panel: what fills it.
        centre_nm: centre of the slot in plate coordinates (plate centre = origin).
        slot_nm: side of the square slot; the panel is not larger.
    """

    name: str
    label: str
    panel: Panel
    centre_nm: Point
    slot_nm: int

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
        number: GDSII/OASIS layer.
        datatype: GDSII/OASIS datatype.
        written: whether the mask writer exposes it (digitized data = clear).
        purpose: one line for the layer table.
    """

    name: str
    number: int
    datatype: int
    written: bool
    purpose: str


CLEAR = Layer("CLEAR", 1, 0, True, "everything that is clear in the chrome: openings, labels, marks")
OUTLINE = Layer("OUTLINE", 10, 0, False, "blank, writable area and die slots, for orientation only")
NOTE = Layer("NOTE", 11, 0, False, "version, job hash and seeds as text, for orientation only")
LAYERS = (CLEAR, OUTLINE, NOTE)


@dataclass(frozen=True)
class Furniture:
    """A mark of the plate that is not a panel.

    Attributes:
        name: identifier, also its cell's name.
        kind: title, label, fiducial, parity, cd or outline.
        layer: where it is drawn.
        polygons: simple, hole-free outlines in plate coordinates, nanometres.
    """

    name: str
    kind: Literal["title", "label", "fiducial", "parity", "cd", "outline"]
    layer: Layer
    polygons: tuple[Polygon, ...]


@dataclass(frozen=True)
class Gauge:
    """A straight probe across one clear feature; its critical dimension is the clear length along the probe.

    Attributes:
        name: identifier in the CD table.
        axis: direction of the probe.
        centre_nm: middle of the probe.
        reach_nm: half the probe's length; wider than the feature and short of its neighbours.
        target_nm: the drawn width.
    """

    name: str
    axis: Literal["x", "y"]
    centre_nm: Point
    reach_nm: int
    target_nm: int


@dataclass(frozen=True)
class Note:
    """Text for people who open the file, on the NOTE layer; never written on the plate."""

    text: str
    position_nm: Point


@dataclass(frozen=True, eq=False)
class Plate:
    """A photomask: blank, dies, marks, and the gauges at which its CDs are measured. Origin: the blank's centre."""

    name: str
    title: str
    blank_nm: int
    writable_nm: int
    dies: tuple[Die, ...]
    furniture: tuple[Furniture, ...]
    gauges: tuple[Gauge, ...]
    notes: tuple[Note, ...]


@dataclass(frozen=True)
class Stop:
    """The lens aperture in the plane of the openings: a circle of that diameter, or a square of that side."""

    shape: Literal["circle", "square"]
    diameter_um: float

    @property
    def area_um2(self) -> float:
        factor = np.pi / 4 if self.shape == "circle" else 1.0
        return float(factor * self.diameter_um**2)


@dataclass(frozen=True)
class Camera:
    """What looks through the panel.

    Attributes:
        focal_um: focal length.
        stop: the lens aperture.
        wavelengths_nm: the lines at which everything is computed.
        pixel_um: side of a sensor pixel.
        window_um: side of the square window in which the PSF is shown.
    """

    focal_um: float
    stop: Stop
    wavelengths_nm: tuple[float, ...]
    pixel_um: float
    window_um: float


@dataclass(frozen=True, eq=False)
class Psf:
    """Intensity per square micrometre of sensor, so that the whole plane holds 1.

    Attributes:
        values: float64 [n, n], n odd, the optical axis on the middle sample.
        step_um: distance between samples.
        wavelength_nm: the line it was computed at.
        kind: ``point`` samples the intensity, ``pixel`` is its mean over square pixels of side ``step_um``.
    """

    values: NDArray[np.float64]
    step_um: float
    wavelength_nm: float
    kind: Literal["point", "pixel"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", frozen(self.values))

    @property
    def energy_in_window(self) -> float:
        """Share of all transmitted energy that falls inside the window (midpoint rule if ``point``)."""
        return float(self.values.sum() * self.step_um**2)


@dataclass(frozen=True, eq=False)
class Mtf:
    """Presampled modulation transfer (optics x sensor pixel) from 0 to half a cycle per pixel.

    Attributes:
        frequency_cy_per_mm: float64 [n], 0 first.
        cuts: float64 [n] each, by name: horizontal, vertical, diagonal (+45), antidiagonal (-45), radial_mean,
            radial_min, radial_max.
        wavelength_nm: the line it was computed at.
        uncertainty: bound on the absolute error of any sample.
    """

    frequency_cy_per_mm: NDArray[np.float64]
    cuts: Mapping[str, NDArray[np.float64]]
    wavelength_nm: float
    uncertainty: float


@dataclass(frozen=True)
class Quantity:
    """One reported number: a row of report.json.

    Attributes:
        uncertainty: half width of the error bar, in ``unit``; None where the value is exact.
        limit: what ``passed`` was judged against; None where nothing is required.
    """

    name: str
    symbol: str
    value: float | int | str | None
    unit: str
    method: str
    uncertainty: float | None = None
    limit: float | int | str | None = None
    passed: bool | None = None
    die: str | None = None
    wavelength_nm: float | None = None


@dataclass(frozen=True, eq=False)
class DieOptics:
    """What one die does to a picture, computed from the polygons read back from the file."""

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
        title: the plate's title.
        job_hash: SHA-256 of the resolved job.
        seeds: seed of every random tiling, by die.
        dies: quantities by die name, in plate order.
        plate: quantities of the whole plate.
        checks: every quantity that was judged, of dies and plate alike.
        files: what was written.
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


def frozen(array: NDArray[Scalar]) -> NDArray[Scalar]:
    """The array itself if nobody can write to it, else a read-only copy."""
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array
