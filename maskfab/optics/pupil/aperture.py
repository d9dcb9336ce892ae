"""A transmission on a rectilinear grid, in the plane of the lens stop, optical axis at the origin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from maskfab.model import ORIENTATIONS, Panel, frozen, refined
from maskfab.optics.pupil.wire_transmission import veil
from maskfab.units import NM_PER_UM


@dataclass(frozen=True)
class Lattice:
    """One axis of a panel: ``cells`` cells of ``dots`` dots each, an opaque strip between neighbouring cells.

    Attributes:
        start_um: lower edge of the first dot.
        dot_um: side of a dot.
        pitch_um: distance between cells, at least dots x dot.
    """

    start_um: float
    cells: int
    dots: int
    dot_um: float
    pitch_um: float

    @property
    def has_gutter(self) -> bool:
        return self.pitch_um > self.dots * self.dot_um * (1 + 1e-12)

    @property
    def period(self) -> int:
        """Intervals from one cell to the next: its dots, and the strip if there is one."""
        return self.dots + 1 if self.has_gutter else self.dots

    def edges_um(self) -> NDArray[np.float64]:
        """Every dot edge once, ascending. With gutters the strip between two cells is one interval."""
        if not self.has_gutter:
            return self.start_um + self.dot_um * np.arange(self.cells * self.dots + 1, dtype=np.float64)
        first = self.start_um + self.pitch_um * np.arange(self.cells, dtype=np.float64)[:, None]
        return (first + self.dot_um * np.arange(self.dots + 1, dtype=np.float64)).ravel()

    def dot_index(self) -> NDArray[np.intp]:
        """Interval number of every dot, [cells, dots]; the gutter strips are left out."""
        return np.arange(self.cells)[:, None] * self.period + np.arange(self.dots)

    def trimmed(self, half_width_um: float) -> Lattice:
        """The lattice without the cells at either end that lie beyond [-half_width, half_width].

        As many are left out at one end as at the other, so that a lattice about the axis stays one; where a cell's
        edge falls on the limit, rounding would else keep it on one side alone.
        """
        first = self.start_um + self.pitch_um * np.arange(self.cells)
        kept = np.flatnonzero((first < half_width_um) & (first + self.dots * self.dot_um > -half_width_um))
        if not kept.size:
            return self
        spare = min(int(kept[0]), self.cells - 1 - int(kept[-1]))
        start = self.start_um + spare * self.pitch_um
        return Lattice(start, self.cells - 2 * spare, self.dots, self.dot_um, self.pitch_um)


@dataclass(frozen=True, eq=False)
class Aperture:
    """Transmission of the openings before the stop cuts them.

    Attributes:
        x, y: the lattices whose edges bound the intervals.
        transmission: float64 [ny, nx] mean amplitude in [0, 1] of every interval pair.
        variance: float64 [ny, nx] variance of the amplitude within each; zero where an interval is uniform.
    """

    x: Lattice
    y: Lattice
    transmission: NDArray[np.float64]
    variance: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "transmission", frozen(self.transmission))
        object.__setattr__(self, "variance", frozen(self.variance))


def finer_aperture(openings: Aperture, times: int) -> Aperture:
    """Openings on dots that are finer by a factor along each side; gutters stay as they are."""
    x, y = (replace(axis, dots=times * axis.dots, dot_um=axis.dot_um / times) for axis in (openings.x, openings.y))
    coarse = np.ix_(openings.y.dot_index().ravel(), openings.x.dot_index().ravel())
    fine = np.ix_(y.dot_index().ravel(), x.dot_index().ravel())

    def spread(values: NDArray[np.float64]) -> NDArray[np.float64]:
        shape = y.edges_um().size - 1, x.edges_um().size - 1
        if not any(values.strides):
            return zeros(shape)
        found = np.zeros(shape)
        found[fine] = refined(values[coarse], times)
        found.flags.writeable = False
        return found

    return Aperture(x, y, spread(openings.transmission), spread(openings.variance))


def covered_aperture(x: Lattice, y: Lattice, coverage: NDArray[np.float64]) -> Aperture:
    """An aperture from the share of every interval that is clear, [ny, nx]; intervals clear in part keep their
    variance c (1 - c), so that energies and error bars stay true."""
    variance = 1 - coverage
    variance *= coverage
    variance.flags.writeable = False
    return Aperture(x, y, coverage, variance)


def panel_lattices(panel: Panel) -> tuple[Lattice, Lattice]:
    """The x and y lattices of a panel whose middle lies on the optical axis."""
    dot, pitch, gutter = panel.dot_nm / NM_PER_UM, panel.cell_size.pitch_um, panel.gutter_nm / NM_PER_UM
    rows, columns = panel.orientations.shape

    def lattice(cells: int) -> Lattice:
        return Lattice(-cells * pitch / 2 + gutter / 2, cells, panel.opening.dots, dot, pitch)

    return lattice(columns), lattice(rows)


def panel_aperture(panel: Panel, half_width_um: float = np.inf) -> Aperture:
    """The design's own aperture: dots straight from the opening and the orientation map, no polygons involved.

    Args:
        panel: what is laid out.
        half_width_um: cells farther than this from the axis are left out.
    """
    whole_x, whole_y = panel_lattices(panel)
    x, y = whole_x.trimmed(half_width_um), whole_y.trimmed(half_width_um)
    column = round((x.start_um - whole_x.start_um) / x.pitch_um)
    row = round((y.start_um - whole_y.start_um) / y.pitch_um)
    chosen = panel.orientations[row : row + y.cells, column : column + x.cells]
    patterns = panel.patterns
    if not panel.tracks:
        transmission = _laid_out(patterns, chosen, x, y)
        return Aperture(x, y, transmission, zeros(transmission.shape))
    turns = np.arange(len(patterns)) % ORIENTATIONS
    amplitude, power = (patterns * values[turns] for values in veil(panel))
    spread = np.clip(power - amplitude**2, 0, None)
    transmission = _laid_out(amplitude, chosen, x, y)
    # Rounding leaves specks where a dot is uniform; real spreads are far above them.
    spread[spread < 1e-14] = 0
    variance = _laid_out(spread, chosen, x, y) if spread.any() else zeros(transmission.shape)
    return Aperture(x, y, transmission, variance)


def _laid_out(
    oriented: NDArray[np.float64] | NDArray[np.bool_], chosen: NDArray[np.int8], x: Lattice, y: Lattice
) -> NDArray[np.float64]:
    """Values of dots [8 openings, dots, dots] over all intervals by what each cell holds; 0 in gutters; read-only."""
    transmission = np.zeros((y.edges_um().size - 1, x.edges_um().size - 1))
    # One row of cells at a time stays in the processor's cache; thousands of dots across would not.
    strip = np.zeros((y.dots, x.cells, x.period))
    for j in range(y.cells):
        for k in np.unique(chosen[j]):
            strip[:, chosen[j] == k, : x.dots] = oriented[k][:, None, :]
        rows = slice(j * y.period, j * y.period + y.dots)
        transmission[rows] = strip.reshape(y.dots, -1)[:, : transmission.shape[1]]
    transmission.flags.writeable = False
    return transmission


def zeros(shape: tuple[int, int]) -> NDArray[np.float64]:
    """Read-only zeros that take no memory, however many."""
    return np.broadcast_to(0.0, shape)
