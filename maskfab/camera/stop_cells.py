"""Transfer of a camera's lens and pixels behind a panel that fills its stop, from the cells that cover it.

The stop's open dots make the pupil p. With A its autocorrelation divided by A(0) (all transmitted energy counts, no
window is laid on the PSF), the transfer from scene samples to pixels is

    H(ν) = sum over k of A(λf (ν + k) / (pixel · dot)) sinc(ν_x + k_x) sinc(ν_y + k_y),    k as far as the stop passes,

ν in cycles per pixel: optics times pixel (Goodman, Introduction to Fourier Optics, 6.3), and what sampling folds back.
Between whole dots A is bilinear, exactly so for square dots. Every factor is separable but A, and A is real, so H is
two real products with matrices of a dozen entries per row.

Notes:
    The stop is the dots whose middle lies in it; no dot is cut. The axis is where four cells meet, so the panel has an
    even number of cells along a side, the least that covers the stop: 24 of 168 um for 4 mm, as for protocol F1; or it
    is in the middle of a cell, and their number is odd.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Complexes, Floats, Singles
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError, OpeningError
from maskfab.base.model import ORIENTATIONS, Panel, Tiling, frozen, orient, refined, side_by_side
from maskfab.base.units import NM_PER_UM
from maskfab.camera.imaging import Isoplanatic
from maskfab.job.camera import Camera, Stop
from maskfab.mask.opening_masks import closed
from maskfab.optics.gap import turned
from maskfab.optics.restoration import squared_modulus
from maskfab.optics.stop import Waves, stop_dots

COLOURS = 3
_SHAPES = ("circle", "square", "annulus")


@dataclass(frozen=True)
class PhotoCamera:
    """A lens behind the panel, and the sensor's pixels.

    Attributes:
        stop: alike under the eight elements of D4, as the cells are turned and mirrored.
        wavelengths_nm: the longest first; three are red, green and blue.

    Raises:
        JobError: MF133 for a stop that is not alike when turned by 90 degrees or mirrored.
    """

    focal_um: float
    stop: Stop
    pixel_um: float
    wavelengths_nm: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.stop.shape not in _SHAPES or len(set(self.stop.sides_um)) > 1:
            what = (
                f"photographs are judged behind stops that look the same turned by 90 degrees or mirrored, and this is "
                f"the {self.stop.shape} of {self.stop.diameter_um:g} um"
            )
            cure = (
                "Give a circle, a square or an annulus; run, analyse, plan, simulate and design with method = "
                '"relax" take other shapes'
            )
            raise JobError("MF133", what, where="camera.stop", cure=cure)
        object.__setattr__(self, "wavelengths_nm", tuple(sorted(self.wavelengths_nm, reverse=True)))

    @classmethod
    def of(cls, camera: Camera, *, where: str = "", colours: bool = False) -> PhotoCamera:
        """The parts of a job's camera that photographs depend on."""
        try:
            lens = cls(camera.focal_um, camera.stop, camera.pixel_um, camera.wavelengths_nm)
            _ = colours and lens.colours_nm
        except JobError as error:
            place = f"{where}: {error.where}" if where else error.where
            raise JobError(error.code, error.what, where=place, cure=error.cure) from None
        return lens

    @property
    def middle_nm(self) -> float:
        """The wavelength that stands for all where one must: green of three, the longer of two."""
        return self.wavelengths_nm[(len(self.wavelengths_nm) - 1) // 2]

    @property
    def shortest_nm(self) -> float:
        """Blue of three."""
        return self.wavelengths_nm[-1]

    @property
    def colours_nm(self) -> tuple[float, ...]:
        """Of red, green and blue. Raises JobError MF134 unless there are three."""
        if len(self.wavelengths_nm) != COLOURS:
            what = f"photographs have red, green and blue, and the camera has {len(self.wavelengths_nm)} wavelengths"
            raise JobError("MF134", what, where="camera.wavelengths", cure="Give three")
        return self.wavelengths_nm

    @property
    def is_f1(self) -> bool:
        """Whether it is the camera of protocol F1.

        What its sampling folds back is taken from the nearest whole lag, as the protocol defines its numbers. Behind
        other cameras it is interpolated, which is exact for square dots.
        """
        return self == F1

    def cycle_um(self, wavelength_nm: float) -> float:
        """The lag in the stop's plane of one cycle per pixel, λf / pixel."""
        return wavelength_nm / NM_PER_UM * self.focal_um / self.pixel_um

    def reach(self, wavelength_nm: float) -> float:
        """The highest frequency that the stop passes along an axis, cycles per pixel."""
        return self.stop.diameter_um / self.cycle_um(wavelength_nm)

    def orders(self, wavelength_nm: float) -> int:
        """Most multiples of the sampling frequency from which anything is folded back to half a cycle per pixel."""
        return max(0, math.ceil(self.reach(wavelength_nm) + 0.5) - 1)


def camera_line(camera: Camera | PhotoCamera) -> str:
    """Lens, stop, pixel and wavelengths in one line, the same for cameras that take the same photographs."""
    lines = "/".join(f"{nm:.15g}" for nm in sorted(camera.wavelengths_nm, reverse=True))
    stop = f"{camera.stop.shape} {_sides(camera.stop)} um"
    return f"focal {camera.focal_um:.15g} um, stop {stop}, pixel {camera.pixel_um:.15g} um, {lines} nm"


def _sides(stop: Stop) -> str:
    if stop.outline_um:
        return ", ".join(f"{x:.15g} {y:.15g}" for x, y in stop.outline_um)
    sides = " x ".join(f"{side:.15g}" for side in dict.fromkeys(stop.sides_um))
    return f"{sides} less {stop.inner_share:.12g}" if stop.inner_share else sides


F1 = PhotoCamera(10_000.0, Stop("circle", 4000.0), 2.0, (610.0, 530.0, 470.0))
"""The camera of protocol F1, of red, green and blue."""

Lagged = NDArray[Any]
"""Of float64, or of complex128 where light has a phase."""

CELLS = 24
"""Cells of 168 um that cover protocol F1's stop, along the panel's side."""
FEWEST_CELLS = 6
"""Along the stop for the mean of all random layouts to tell one: of 4 x 4 it lies up to 2 dB from that."""
PITCH_UM = 168.0
"""Of the cells that are meant where no dot is given."""
MOST_DOTS = 2048
"""Along the panel's side; its autocorrelation then takes half a gigabyte."""
FEWEST_ACROSS = 64
"""Dots across the stop of another camera than protocol F1's: of whole ones, a smaller one has no round edge."""
FEWEST_PER_CYCLE = 32
MOST_PER_CYCLE = 2048
"""Dots of lag to one cycle per pixel: lags are frequencies, and stand for the whole square of them."""

_ORDERS, _FOLDED = 3, 2  # orders summed at least; beyond the stop they add nothing
_ROUNDING = 1e-9
"""Of an autocorrelation, 1 at lag 0."""


@dataclass(frozen=True)
class CellGrid:
    """Cells of dots that cover a camera's stop."""

    dots: int
    cells: int
    dot_um: float
    camera: PhotoCamera = F1

    @property
    def side(self) -> int:
        """Dots along the panel's side."""
        return self.cells * self.dots

    @property
    def stop(self) -> NDArray[np.bool_]:
        """The dots within the stop, [side, side]."""
        return stop_dots(self.camera.stop, self.side, self.dot_um)

    def turned(self, waves: Waves) -> Complexes:
        """Amplitude behind the open stop of light with a phase, constant over a dot, [side, side]."""
        middles = (np.arange(self.side, dtype=np.float64) - (self.side - 1) / 2) * self.dot_um
        try:
            return turned(waves, middles, middles, self.stop)
        except JobError as refusal:
            cure = "Use smaller dots, or ask for less depth or aberration" if refusal.code == "MF115" else refusal.cure
            raise JobError(refusal.code, refusal.what, where=refusal.where, cure=cure) from None

    def per_cycle(self, wavelength_nm: float) -> float:
        """Lag in dots that belongs to one cycle per pixel."""
        return self.camera.cycle_um(wavelength_nm) / self.dot_um


def lattice(
    dots: int, dot_nm: int | None = None, *, camera: PhotoCamera = F1, odd: bool = False, where: str = "design.dots"
) -> CellGrid:
    """The fewest cells of ``dots`` dots a side that cover the stop.

    Args:
        dot_nm: side of a dot; None for cells of 168 um, however many dots they have.
        odd: the axis is in the middle of a cell; otherwise four cells meet there.

    Raises:
        JobError: MF104 for a number below 1, or dots so large that half a cycle per pixel is a lag of less than one;
            MF115 for more than 2048 dots along the panel's side; MF135 for another camera than protocol F1's with fewer
            than 64 dots across the stop, or with other than 32 to 2048 dots of lag to one cycle per pixel.
    """
    if dots < 1 or (dot_nm is not None and dot_nm < 1):
        what = f"{dots} dots of {dot_nm} nm make no cell"
        raise JobError("MF104", what, where=where, cure="Give at least 1 dot of 1 nm")
    dot_um = PITCH_UM / dots if dot_nm is None else dot_nm / NM_PER_UM
    pitch_nm = PITCH_UM * NM_PER_UM if dot_nm is None else CellSize(dots, dot_nm).pitch_nm
    half = camera.stop.diameter_um * NM_PER_UM / (2 * pitch_nm)
    made = CellGrid(dots, 2 * math.ceil(half - 0.5) + 1 if odd else 2 * math.ceil(half), dot_um, camera)
    _require_lags(made, where)
    if made.side > MOST_DOTS:
        across = camera.stop.diameter_um
        what = (
            f"the stop of {across:g} um takes {made.cells} cells of {dots} dots of {made.dot_um:g} um, {made.side} "
            f"dots along a side; the limit is {MOST_DOTS}"
        )
        cure = f"Draw the opening with dots of {across / MOST_DOTS:.3g} um or more"
        raise JobError("MF115", what, where=where, cure=cure)
    return made


def _require_lags(room: CellGrid, where: str) -> None:
    """Refuse dots that are too coarse, or too fine, for a camera's frequencies."""
    camera = room.camera
    coarsest = camera.cycle_um(camera.shortest_nm) / 2
    if room.dot_um > coarsest:
        what = f"a dot of {room.dot_um:g} um is wider than {coarsest:g} um, the lag of half a cycle per pixel"
        raise JobError("MF104", what, where=where, cure="Draw the opening with smaller dots")
    if camera.is_f1:
        return
    across = camera.stop.diameter_um / room.dot_um
    least, most = (room.per_cycle(nm) for nm in (camera.shortest_nm, camera.wavelengths_nm[0]))
    if across < FEWEST_ACROSS:
        what = (
            f"the stop of {camera.stop.diameter_um:g} um is {across:.3g} dots of {room.dot_um:g} um across; "
            f"photographs are judged through whole dots, of which it must be {FEWEST_ACROSS}"
        )
        raise JobError("MF135", what, where=where, cure="Use smaller dots, or a larger stop")
    if least < FEWEST_PER_CYCLE or most > MOST_PER_CYCLE:
        what = (
            f"one cycle per pixel of {camera.pixel_um:g} um is a lag of {least:.0f} to {most:.0f} dots of "
            f"{room.dot_um:g} um; the limits are {FEWEST_PER_CYCLE} and {MOST_PER_CYCLE}"
        )
        cure = f"Use {'smaller' if least < FEWEST_PER_CYCLE else 'larger'} dots"
        raise JobError("MF135", what, where=where, cure=cure)


@dataclass(frozen=True, eq=False)
class Laid(Isoplanatic):
    """A panel of cells, as light sees it inside the stop: a design to be photographed.

    Attributes:
        pupil: float64 [side, side], amplitude of every dot, 0 outside the stop.
    """

    pupil: Floats
    lattice: CellGrid

    @property
    def transmission(self) -> float:
        """Share of the stop's light that passes: its clear area, or the energy of a grey pupil."""
        return float((self.pupil**2).sum() / self.lattice.stop.sum())

    def _transfer(self, shape: tuple[int, int]) -> NDArray[np.float32]:
        return pupil_transfer(self.pupil, self.lattice, shape)


def lay(
    name: str,
    units: NDArray[np.bool_],
    orientations: NDArray[np.int8] | None = None,
    seed: int = 0,
    *,
    dot_nm: int | None = None,
    room: CellGrid | None = None,
) -> Laid:
    """Lay one opening, or several, over the panel.

    Args:
        units: bool [dots, dots] or [units, dots, dots], True is clear, row 0 the lowest.
        orientations: integers [cells, cells], 24 x 24 of 168 um, 8 u + k for unit u under element k of D4 as in
            :func:`maskfab.base.model.orient`; None draws them as protocol F1 does, with
            ``default_rng(seed).integers(8 · units)``.
        room: the cells, in place of the fewest of such dots behind protocol F1's stop.

    Raises:
        OpeningError: MF201 if the openings are not square; MF202 if they are neither clear nor opaque; MF203 if closed.
        JobError: MF122 for orientations of another shape, or of units that are not there; MF104, MF115 as
            :func:`lattice`.
    """
    stack = np.asarray(units)
    stack = stack[None] if stack.ndim == 2 else stack
    if stack.ndim != 3 or stack.shape[1] != stack.shape[2] or stack.size == 0:
        what = f"the opening has the shape {np.shape(units)}"
        raise OpeningError("MF201", what, where=name, cure="Give an array of dots x dots")
    if stack.dtype != np.bool_ and not np.isin(stack, (0, 1)).all():
        what = "the opening has other values than 0 and 1"
        raise OpeningError("MF202", what, where=name, cure="Threshold the opening to 0 (opaque) and 1 (clear)")
    if not stack.any():
        raise closed(0, stack.size, where=name, cure="Give an opening with at least 1 clear dot")
    kinds = ORIENTATIONS * len(stack)
    room = lattice(stack.shape[1], dot_nm, where=name) if room is None else room
    size = room.cells, room.cells
    if orientations is None:
        orientations = np.random.default_rng(seed).integers(kinds, size=size).astype(np.int8)
    turned = np.asarray(orientations)
    if turned.shape != size or turned.min() < 0 or turned.max() >= kinds:
        reach = f" and reach from {turned.min()} to {turned.max()}" if turned.size else ""
        cure = f"Give {room.cells} x {room.cells} integers from 0 to {kinds - 1}"
        raise JobError("MF122", f"the orientations have the shape {turned.shape}{reach}", where=name, cure=cure)
    cells = np.stack([orient(unit, k) for unit in stack for k in range(ORIENTATIONS)]).astype(np.float64)
    return Laid(name, side_by_side(cells[turned]) * room.stop, room)


def pupil_autocorrelation(pupil: Lagged) -> Lagged:
    """Σ a(r) a*(r + s) of a pupil of whole dots [n, n]: [2n - 1, 2n - 1], lag 0 in the middle, not normalised.

    Reports take :mod:`maskfab.optics.lags`, which knows gutters and dots that the stop cuts; descents
    :mod:`maskfab.designs.descent.objective`, which has a slope.
    """
    real = np.isrealobj(pupil)
    fast = int(scipy.fft.next_fast_len(2 * len(pupil) - 1, real=real))
    power = squared_modulus((scipy.fft.rfft2 if real else scipy.fft.fft2)(pupil, (fast, fast), workers=1))
    if real:
        table = scipy.fft.irfft2(power, (fast, fast), workers=1)
    else:
        table = scipy.fft.fft2(power, norm="forward", workers=1)
    lags = np.arange(-len(pupil) + 1, len(pupil)) % fast
    return np.asarray(table[np.ix_(lags, lags)])


@lru_cache(maxsize=1)
def _open_table(room: CellGrid) -> Floats:
    """Autocorrelation of the open stop; of every colour, and of one design's every judge, the same."""
    return frozen(pupil_autocorrelation(room.stop.astype(np.float64)))


def at_lags(table: Lagged, y: NDArray[np.int64], x: NDArray[np.int64]) -> Lagged:
    """An autocorrelation [2n - 1, 2n - 1] at whole lags, 0 beyond."""
    reach = len(table) // 2
    inside = (abs(y) <= reach) & (abs(x) <= reach)
    return np.asarray(table[np.clip(y, -reach, reach) + reach, np.clip(x, -reach, reach) + reach] * inside)


@dataclass(frozen=True, eq=False)
class OpenStop:
    """Transfer of the open stop and the pixel, one colour.

    Attributes:
        table: its autocorrelation, [2 side - 1, 2 side - 1], 1 at lag 0 in the middle; complex behind a lens whose
            phase is not the same turned by 180 degrees.
        whole_lags: take the nearest whole lag; otherwise interpolate between them, which is exact for square dots.
    """

    table: Lagged
    dots: float
    per_cycle: float
    orders: int
    whole_lags: bool

    @classmethod
    def of(
        cls, room: CellGrid, wavelength_nm: float, per_cycle: float | None = None, amplitude: Complexes | None = None
    ) -> OpenStop:
        """The open stop at one wavelength; the ``amplitude`` of :meth:`CellGrid.turned` where light has a phase."""
        table = _open_table(room) if amplitude is None else pupil_autocorrelation(amplitude)
        area = float(table[room.side - 1, room.side - 1].real)
        table = table / area
        if np.iscomplexobj(table) and abs(table.imag).max() < _ROUNDING:
            table = np.ascontiguousarray(table.real)
        orders = max(_FOLDED, room.camera.orders(wavelength_nm))
        return cls(table, area, per_cycle or room.per_cycle(wavelength_nm), orders, room.camera.is_f1)

    def __call__(self, y: Floats, x: Floats) -> Lagged:
        """At frequencies in cycles per pixel, any shape."""
        lags = y * self.per_cycle, x * self.per_cycle
        if self.whole_lags:
            values = self.at(*(np.rint(lag).astype(np.int64) for lag in lags))
        else:
            v, u = (np.floor(lag).astype(np.int64) for lag in lags)
            y_part, x_part = lags[0] - v, lags[1] - u
            below = (1 - x_part) * self.at(v, u) + x_part * self.at(v, u + 1)
            above = (1 - x_part) * self.at(v + 1, u) + x_part * self.at(v + 1, u + 1)
            values = (1 - y_part) * below + y_part * above
        return np.asarray(values * np.sinc(y) * np.sinc(x))

    def at(self, y: NDArray[np.int64], x: NDArray[np.int64]) -> Lagged:
        """The autocorrelation at whole lags."""
        return at_lags(self.table, y, x)

    def folded(self, y: Floats, x: Floats) -> Lagged:
        """Sum of what sampling folds back at the given frequencies."""
        around = range(-self.orders, self.orders + 1)
        total = np.zeros(np.broadcast(y, x).shape, dtype=self.table.dtype)
        for k in around:
            for j in around:
                if (k, j) != (0, 0):
                    total += self(y + k, x + j)
        return total


def pupil_transfer(pupil: Floats, room: CellGrid, shape: tuple[int, int]) -> Singles:
    """H of a pupil [side, side] on such cells for pictures of a shape, float32 [3, rows, columns / 2 + 1]; 1 at 0."""
    y, x = scipy.fft.fftfreq(shape[0]), scipy.fft.rfftfreq(shape[1])
    table = pupil_autocorrelation(pupil)
    table /= table[room.side - 1, room.side - 1]
    colours = room.camera.colours_nm
    transfer = np.empty((len(colours), shape[0], len(x)), dtype=np.float32)
    for colour, line_nm in enumerate(colours):
        along_y, along_x = (_from_lags(frequency, room, line_nm) for frequency in (y, x))
        transfer[colour] = (along_x @ np.ascontiguousarray((along_y @ table).T)).T
    return transfer


def _from_lags(frequency: Floats, room: CellGrid, wavelength_nm: float) -> scipy.sparse.csr_array:
    """Matrix [frequencies, 2 side - 1] from lags: bilinear weights times the pixel's sinc, summed over the orders."""
    most, side = max(_ORDERS, room.camera.orders(wavelength_nm)), room.side
    orders = np.arange(-most, most + 1)
    nu = frequency[:, None] + orders
    lag = nu * room.per_cycle(wavelength_nm)
    below = np.floor(lag).astype(np.int64)
    beyond = lag - below
    pixel = np.sinc(nu)
    row = np.broadcast_to(np.arange(len(frequency))[:, None], nu.shape)
    column = np.concatenate([below, below + 1], axis=1) + side - 1
    weight = np.concatenate([pixel * (1 - beyond), pixel * beyond], axis=1)
    inside = (column >= 0) & (column < 2 * side - 1) & (weight != 0)
    place = np.concatenate([row, row], axis=1)[inside], column[inside]
    return scipy.sparse.csr_array((weight[inside], place), shape=(len(frequency), 2 * side - 1))


def laid_panel(name: str, panel: Panel, camera: PhotoCamera = F1) -> Laid:
    """The design that a panel is, for :func:`maskfab.camera.protocol.evaluate`.

    A random tiling is drawn as the protocol draws it, so that designs differ by their openings alone; other tilings
    are taken from the panel's middle, which is the axis; protocol F1 has its axis where four cells meet, so a panel of
    an odd number of cells is seen half a cell off its middle there. A gutter becomes closed dots round the opening;
    where half of it is no whole number of dots, all dots are halved, or divided further, until it is one.

    Raises:
        JobError: MF122 for a hexagonal tiling, fewer cells than cover the stop, or an axis that is in the middle of a
            cell along one side alone; MF115 for more than 2048 dots along the side of these; MF104, MF135 for dots
            that are too large or too small.
    """
    if panel.tiling is Tiling.HEXAGONAL:
        what = f"{name} has its cells on a hexagonal lattice; photographs are judged through square cells"
        raise JobError("MF122", what, where=name, cure="Name dies with another tiling")
    rows, columns = panel.orientations.shape
    drawn = panel.tiling is Tiling.RANDOM
    if not (drawn or camera.is_f1 or rows % 2 == columns % 2):
        what = f"{name} has {columns} x {rows} cells: the axis is in the middle of a cell along one side only"
        raise JobError("MF122", what, where=name, cure="Use even numbers of both, or odd ones")
    times, rim, room = _whole_dots(name, panel, camera, odd=bool(rows % 2) and not (drawn or camera.is_f1))
    units = np.stack([np.pad(refined(opening.mask, times), rim) for opening in panel.openings])
    if drawn:
        return lay(name, units, room=room)
    cells = room.cells
    if min(rows, columns) < cells:
        what = (
            f"{name} has {columns} x {rows} cells of {panel.cell_size.pitch_um:g} um, fewer than the {cells} x {cells} "
            f"that cover a stop of {camera.stop.diameter_um:g} um"
        )
        raise JobError("MF122", what, where=name, cure=f"Use a die of at least {cells * panel.pitch_nm / 1e6:.3g} mm")
    bottom, left = (rows - cells) // 2, (columns - cells) // 2
    middle = panel.orientations[bottom : bottom + cells, left : left + cells]
    return lay(name, units, middle, room=room)


def _whole_dots(name: str, panel: Panel, camera: PhotoCamera, *, odd: bool) -> tuple[int, int, CellGrid]:
    """Dots that openings and gutters are whole numbers of: how many along a panel's dot, beside it, and the cells."""
    half = panel.gutter_nm // 2
    dot_nm = math.gcd(panel.dot_nm, half) if half else panel.dot_nm
    times = panel.dot_nm // dot_nm
    dots = panel.pitch_nm // dot_nm
    try:
        return times, half // dot_nm, lattice(dots, dot_nm, camera=camera, odd=odd, where=name)
    except JobError as error:
        if times == 1 or error.code != "MF115":
            raise
        what = (
            f"half a gutter of {half / NM_PER_UM:g} um and dots of {panel.dot_nm / NM_PER_UM:g} um are whole only on "
            f"dots of {dot_nm / NM_PER_UM:g} um, too many behind a stop of {camera.stop.diameter_um:g} um; the limit "
            f"is {MOST_DOTS} along a side"
        )
        raise JobError("MF115", what, where=name, cure="Make the gutter an even number of dots wide") from error
