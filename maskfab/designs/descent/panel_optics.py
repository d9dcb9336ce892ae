"""PSF and MTF of a panel of one relaxed unit, with every derivative by the unit's dots.

The field is that of :mod:`maskfab.optics.field.matrix`: the amplitude, split into parts even and odd in x and in y, is
multiplied by real waves along y and along x. It is linear in the dots, and so is all that leads to it, so that the
slope of a loss runs through the same products backwards: with the field F = Σ t_k F_k, the norm N = (λf)² E and the
PSF |F|² / N,

    dL/dt_k = Σ dL/dPSF (2 Re(F* F_k) - PSF dN/dt_k) / N.

**The stop's edge cuts dots exactly.** A cut dot's field has the Legendre orders p of its shape,
w (-i)^p (2p + 1) j_p(πuw) exp(-2πiuc), where a whole one has w j_0(πuw) alone. Up to the highest frequency of the
window the quotient is smooth, and a few whole dots about the cut one stand for it,

    (2p + 1) (-i)^p j_p(πuw) / j_0(πuw)  =  Σ_a c_pa exp(-2πiu (x_a - c)),    |u| <= u_max,

by least squares; they grow in number until the equation's residual is below a tolerance. So the rim costs a scattered
sum of a few hundred thousand terms, and the products are those of whole dots. Dots that are coarse for the window, and
gutters, are filled with finer sources until there are four in the shortest period of the field.

**Fine dots are merged.** Where a dot is a small part of that period, sources of several dots' width stand for dots in
the same way. Within a cell they are a product of matrices, and cells that the stop does not cut share one, turned.

**The MTF** is read from the autocorrelation of :mod:`maskfab.designs.descent.objective`, that of the descent's losses,
with cut dots by their mean transmission, as :meth:`maskfab.optics.lags.LagTable.coarse_otf` has it. Gutters take the
lags of cells and of dots apart.

Notes:
    Grey is an amplitude: a dot of 0.5 passes a quarter of the light, as in the descent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.base.arrays import Complexes, Floats, Indices, Labels
from maskfab.base.model import Panel, split_cells, unit_dots
from maskfab.designs.descent.objective import Autocorrelation, transform_size
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import rim_orders
from maskfab.optics.lags import lag_sizes, neighbours
from maskfab.optics.mtf import RINGS, longest_lag_um
from maskfab.optics.polynomials import spherical_bessel
from maskfab.optics.psf import image_scale_um2, odd_samples, pixel_margin, pixel_means, point_step_um, psf_norm_um6
from maskfab.optics.pupil import Lattice, Pupil, cut, panel_aperture

# Sources in the shortest period of the field; with half as many the fit would need many more of them.
_PER_PERIOD = 4
# Largest residual, as far as cut dots share in the light.
_TOLERANCES = {torch.float64: 1e-9, torch.float32: 3e-7}
_FEWEST, _MOST = 2, 16
"""Sources to either side that stand for a cut dot."""
_FIT_POINTS = 96
_MERGED_TOLERANCES = {torch.float64: 3e-13, torch.float32: 3e-8}
"""Largest residual of sources that stand for all dots."""
_FINE = 32
"""Dots of a cell from which wider sources save time."""


@dataclass(frozen=True, eq=False)
class Layout:
    """Where in a stop the dots of a panel's unit lie.

    Attributes:
        place: intp [ny, nx], the unit's dot at every interval of the pupil; -1 in gutters.
        turned: int8 [cells y, cells x], orientations of the pupil's cells.
    """

    pupil: Pupil
    place: Indices
    dots: int
    turned: Labels

    @classmethod
    def of(cls, panel: Panel, stop: Stop) -> Layout:
        """The layout of a panel of one opening, without wires."""
        clear = replace(panel.opening, mask=np.ones_like(panel.opening.mask))
        pupil = cut(panel_aperture(replace(panel, opening=clear), stop.diameter_um / 2), stop)
        rows, columns = panel.orientations.shape
        row, column = (rows - pupil.y.cells) // 2, (columns - pupil.x.cells) // 2
        turned = panel.orientations[row : row + pupil.y.cells, column : column + pupil.x.cells]
        place = np.full(pupil.whole.shape, -1, dtype=np.intp)
        dots = panel.opening.dots
        place[np.ix_(pupil.y.dot_index().ravel(), pupil.x.dot_index().ravel())] = unit_dots(turned, dots)
        return cls(pupil, place, dots, turned)

    def summed(self, values: Floats) -> Floats:
        """Sums of values of intervals [ny, nx] over all that hold each dot of the unit, [dots²]."""
        held = values > 0
        return np.bincount(self.place[held], values[held], self.dots**2).astype(np.float64, copy=False)


def _here(array: NDArray[Any], dtype: torch.dtype, device: str | torch.device) -> torch.Tensor:
    """A constant on a device; floating ones in that type."""
    made = torch.from_numpy(np.array(array)).to(device)
    return made.to(dtype) if made.is_floating_point() else made


@dataclass(frozen=True, eq=False)
class Spread:
    """A linear map from a unit's dots to sources, in the four quadrants of the stop, right above first, or in cells.

    Attributes:
        shape: of the sources: 4, h and w, or cells and their dots.
        whole: int64 [sources], the dot at each source; one more than the last where there is none.
        place, dot, weight: [k] each, further terms: the dots that the stop cuts.
    """

    shape: tuple[int, int, int]
    whole: torch.Tensor
    place: torch.Tensor
    dot: torch.Tensor
    weight: torch.Tensor

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Strengths [..., *shape] of the sources of a unit [..., dots, dots]."""
        laid: torch.Tensor = _Laid.apply(unit.flatten(-2), self)  # type: ignore[no-untyped-call]
        return laid.view(*unit.shape[:-2], *self.shape)

    def lay(self, dots: torch.Tensor) -> torch.Tensor:
        """[..., dots] to [..., sources]."""
        laid = torch.nn.functional.pad(dots, (0, 1)).index_select(-1, self.whole)
        cut = dots.index_select(-1, self.dot) * self.weight
        return laid.scatter_add_(-1, self.place.expand(cut.shape), cut)

    def gather(self, slopes: torch.Tensor, dots: int) -> torch.Tensor:
        """The adjoint: [..., sources] to [..., dots]."""
        home = slopes.new_zeros((*slopes.shape[:-1], dots + 1))
        home.scatter_add_(-1, self.whole.expand(slopes.shape), slopes)
        cut = slopes.index_select(-1, self.place) * self.weight
        return home.scatter_add_(-1, self.dot.expand(cut.shape), cut)[..., :-1]


class _Laid(torch.autograd.Function):
    """A spread as a step of autograd; its derivative is the adjoint, whose derivative it is."""

    @staticmethod
    def forward(ctx: Any, dots: torch.Tensor, spread: Spread) -> torch.Tensor:
        ctx.spread, ctx.dots = spread, dots.shape[-1]
        return spread.lay(dots)

    @staticmethod
    def backward(ctx: Any, slopes: torch.Tensor) -> tuple[torch.Tensor, None]:
        return _Gathered.apply(slopes, ctx.spread, ctx.dots), None  # type: ignore[no-untyped-call]


class _Gathered(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, slopes: torch.Tensor, spread: Spread, dots: int) -> torch.Tensor:
        ctx.spread = spread
        return spread.gather(slopes, dots)

    @staticmethod
    def backward(ctx: Any, dots: torch.Tensor) -> tuple[torch.Tensor, None, None]:
        return _Laid.apply(dots, ctx.spread), None, None  # type: ignore[no-untyped-call]


@dataclass(frozen=True, eq=False)
class Merged:
    """A linear map from a unit's dots to sources that are several dots wide, cell by cell.

    Attributes:
        cells: from the dots to those of cells; the first is the unit, the others are those that the stop cuts.
        matrix: [sources, dots], along either axis, of a cell and what lies beside it.
        laid: from the sources of cells to the four quadrants of the stop.
    """

    cells: Spread
    matrix: torch.Tensor
    laid: Spread

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Strengths [..., 4, h, w] of the sources of a unit [..., dots, dots]."""
        return self.laid((self.matrix @ self.cells(unit) @ self.matrix.T).flatten(-3, -2))


@dataclass(frozen=True, eq=False)
class PointImage:
    """The PSF of one layout behind one camera at one wavelength, a function of the unit's dots.

    Attributes:
        spread: from the dots to sources.
        up: [2, n, h], waves along y, even and odd, at the frequencies from 0.
        across: [2, w, n], along x.
        energy: [dots²], in µm⁶: what the norm gains with the square of each dot.
        means: [pixels, samples], of samples to pixels; None for points.
        step_um: between samples, or the pixel.
    """

    spread: Spread | Merged
    up: torch.Tensor
    across: torch.Tensor
    energy: torch.Tensor
    means: torch.Tensor | None
    step_um: float

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """The PSF [..., samples, samples] per square micrometre of units [..., dots, dots], the axis in the middle."""
        # Mirror images add in the even part and subtract in the odd one.
        right_up, left_up, right_down, left_down = self.spread(unit).unbind(-3)
        even_x, odd_x = (right_up + left_up, right_down + left_down), (right_up - left_up, right_down - left_down)
        (ee, oe), (eo, oo) = (
            (self._part(up + down, 0, k), self._part(up - down, 1, k)) for k, (up, down) in enumerate((even_x, odd_x))
        )
        norm = (self.energy * unit.flatten(-2) ** 2).sum(-1)[..., None, None]
        same = ((ee - oo).square() + (oe + eo).square()) / norm
        opposite = ((ee + oo).square() + (oe - eo).square()) / norm
        # Opposite frequencies of a real amplitude are alike.
        upper = torch.cat([opposite[..., 1:].flip(-1), same], -1)
        samples = torch.cat([upper[..., 1:, :].flip(-2, -1), upper], -2)
        return samples if self.means is None else self.means @ samples @ self.means.T

    def _part(self, sources: torch.Tensor, odd_y: int, odd_x: int) -> torch.Tensor:
        return self.up[odd_y] @ (sources @ self.across[odd_x])


def point_image(
    panel: Panel,
    camera: Camera,
    wavelength_nm: float,
    *,
    pixels: bool = False,
    dtype: torch.dtype = torch.float64,
    device: str | torch.device = "cpu",
) -> PointImage:
    """The PSF of panels that are laid out like a given one, whatever their opening.

    Args:
        panel: gives dots, gutters and orientations; of one opening, without wires.
        camera: gives lens, window and pixel; its wavelengths decide how close samples lie.
        pixels: means over sensor pixels instead of intensity at points.
    """
    step, scale = point_step_um(camera), image_scale_um2(camera, wavelength_nm)
    reach = odd_samples(camera.window_um, step) // 2 + (pixel_margin(camera) if pixels else 0)
    frequency = step * np.arange(reach + 1, dtype=np.float64) / scale
    layout = Layout.of(panel, camera.stop)
    here = partial(_here, dtype=dtype, device=device)
    spread, sources = _spread(layout, float(frequency[-1]), dtype, here)
    up, across = (np.stack(axis.waves(frequency)) for axis in sources)
    pupil = layout.pupil
    energy = layout.summed(pupil.mean_transmission) * pupil.x.dot_um * pupil.y.dot_um
    means = pixel_means(camera, step, 2 * reach + 1, wavelength_nm) if pixels else None
    return PointImage(
        spread,
        here(up.transpose(0, 2, 1)),
        here(across),
        here(psf_norm_um6(scale, 1.0) * energy),
        None if means is None else here(means),
        camera.pixel_um if pixels else step,
    )


@dataclass(frozen=True, eq=False)
class _Axis:
    """Sources along one axis: places, ascending; widths; intp [intervals], first source of a dot, -1 for gutters."""

    position_um: Floats
    width_um: float
    first: Indices
    parts: int

    @classmethod
    def of(cls, lattice: Lattice, highest: float, reach: int) -> _Axis:
        """Sources in every dot of a lattice, in its gutters, and so many beyond its ends."""
        parts = max(1, math.ceil(_PER_PERIOD * highest * lattice.dot_um - 1e-9))
        width = lattice.dot_um / parts
        edges = lattice.edges_um()
        is_dot = np.zeros(edges.size - 1, dtype=np.bool_)
        is_dot[lattice.dot_index().ravel()] = True
        beyond = width * (np.arange(reach) + 0.5)
        held, first, count = [edges[0] - beyond[::-1]], np.full(is_dot.size, -1), reach
        for k, (low, high) in enumerate(pairwise(edges)):
            within = parts if is_dot[k] else round((high - low) / width)
            held.append(low + (high - low) * (np.arange(within) + 0.5) / max(within, 1))
            first[k] = count if is_dot[k] else -1
            count += within
        held.append(edges[-1] + beyond)
        return cls(np.concatenate(held), width, first, parts)

    @property
    def half(self) -> int:
        return (self.position_um.size + 1) // 2

    def folded(self, source: Indices) -> tuple[Indices, Indices]:
        """Whether sources lie left of the axis, and their place among those right of it."""
        middle = self.position_um.size // 2
        left = source < middle
        return left.astype(np.intp), np.where(left, self.position_um.size - 1 - source, source) - middle

    def waves(self, frequency: Floats) -> tuple[Floats, Floats]:
        """Cosines and sines of the sources right of the axis, [half, n] each, a source's own transform in them."""
        place = self.position_um[-self.half :, None]
        cycles = np.remainder(place * frequency, 1.0)
        size = self.width_um * np.sinc(self.width_um * frequency)
        return size * np.cos(2 * np.pi * cycles), size * np.sin(2 * np.pi * cycles)

    def stand_ins(
        self, edges: tuple[Floats, Floats], orders: int, highest: float, reach: int
    ) -> tuple[Indices, Floats, float]:
        """Sources that stand for the Legendre orders of intervals between edges [k], so many to either side of each.

        Returns:
            The first source of each interval, [k]; strengths [k, orders, sources]; the largest residual.
        """
        low, high = edges
        count = 2 * reach + self.parts
        first = np.clip(np.searchsorted(self.position_um, low) - reach, 0, self.position_um.size - count)
        offset = self.position_um[first[:, None] + np.arange(count)] - (low + high)[:, None] / 2
        # Inside a lattice all dots see their neighbours alike.
        alike, which = np.unique(np.round(offset, 9), axis=0, return_inverse=True)
        fits = [self.fit(away, float(high[0] - low[0]), orders, highest) for away in alike]
        error = max(residual for _, residual in fits)
        return first, np.stack([strength for strength, _ in fits])[which.ravel()], error

    def fit(self, offset: Floats, width: float, orders: int, highest: float) -> tuple[Floats, float]:
        """Strengths [orders, sources] at offsets from an interval's middle, and the largest residual."""
        u = highest * np.cos(np.pi * (np.arange(_FIT_POINTS) + 0.5) / (2 * _FIT_POINTS))
        order = np.arange(orders)
        own = width * spherical_bessel(np.pi * width * u, orders) * ((2 * order + 1) * 1.0)[:, None]
        own = (own * (-1j) ** order[:, None]).T
        source = self.width_um * np.sinc(self.width_um * u)[:, None]
        waves: Complexes = source * np.exp(-2j * np.pi * u[:, None] * offset)
        matrix, wanted = np.concatenate([waves.real, waves.imag]), np.concatenate([own.real, own.imag])
        strength = np.linalg.lstsq(matrix, wanted, rcond=1e-14)[0]
        return strength.T, float(abs(matrix @ strength - wanted).max()) / width


Terms: TypeAlias = tuple[Indices, Indices, Indices, Floats]
"""Row and column of sources, the dot, and its weight there, [k] each."""


def _spread(
    layout: Layout, highest: float, dtype: torch.dtype, here: Callable[[NDArray[Any]], torch.Tensor]
) -> tuple[Spread | Merged, tuple[_Axis, _Axis]]:
    """A spread to the sources along y and x, and those."""
    terms, (up, across) = _of_cut(layout, highest, _TOLERANCES[dtype])
    merged = _merged(layout, highest)
    if merged > 1:
        return _of_cells(layout, highest, merged, (terms, up, across), dtype, here)
    row, column, dot, weight = terms
    arrays = _of_whole(layout, up, across), _place(up, across, row, column), dot, weight
    return Spread((4, up.half, across.half), *map(here, arrays)), (up, across)


def _merged(layout: Layout, highest: float) -> int:
    """Dots that one source may be wide, in cells without gutters between them."""
    x, y, dots = layout.pupil.x, layout.pupil.y, layout.dots
    if x.has_gutter or y.has_gutter or dots < _FINE:
        return 1
    most = 1 / (_PER_PERIOD * highest * x.dot_um)
    return max(times for times in range(1, dots + 1) if dots % times == 0 and times <= max(most, 1))


def _of_cut(layout: Layout, highest: float, tolerance: float) -> tuple[Terms, tuple[_Axis, _Axis]]:
    """Whole dots that stand for cut ones, and the sources along y and x."""
    pupil, places, row, column = layout.pupil, layout.place, layout.pupil.rim_row, layout.pupil.rim_column
    orders = rim_orders(pupil, highest, highest)
    tolerance *= 1 + np.count_nonzero(pupil.whole) / max(row.size, 1)
    for reach in range(_FEWEST if row.size else 0, _MOST + 1):
        across = _Axis.of(pupil.x, highest, reach)
        up = across if pupil.x == pupil.y else _Axis.of(pupil.y, highest, reach)
        if not row.size:
            return _NOTHING, (up, across)
        (rows, along_y, error_y), (columns, along_x, error_x) = (
            axis.stand_ins((edges[at], edges[at + 1]), orders, highest, reach)
            for axis, edges, at in ((up, pupil.y.edges_um(), row), (across, pupil.x.edges_um(), column))
        )
        if max(error_y, error_x) <= tolerance:
            break
    weight = np.einsum("kqa,kqp,kpb->kab", along_y, pupil.moments(orders), along_x, optimize=True)
    shape = weight.shape
    along = (rows[:, None] + np.arange(shape[1]))[:, :, None], (columns[:, None] + np.arange(shape[2]))[:, None, :]
    dot = places[row, column][:, None, None]
    at_row, at_column, of_dot = (np.broadcast_to(each, shape).ravel() for each in (*along, dot))
    return (at_row, at_column, of_dot, weight.ravel()), (up, across)


_NO_PLACE = np.zeros(0, dtype=np.intp)
_NOTHING: Terms = _NO_PLACE, _NO_PLACE, _NO_PLACE, np.zeros(0)
"""Of a stop that cuts no dot."""


def _of_cells(
    layout: Layout,
    highest: float,
    merged: int,
    cut: tuple[Terms, _Axis, _Axis],
    dtype: torch.dtype,
    here: Callable[[NDArray[Any]], torch.Tensor],
) -> tuple[Merged, tuple[_Axis, _Axis]]:
    """Sources so many dots wide: once for all whole cells, and for each cell that the stop cuts."""
    (row, column, dot, weight), fine_up, fine_across = cut
    x, y, dots = layout.pupil.x, layout.pupil.y, layout.dots
    whole = split_cells(layout.pupil.whole > 0, dots, dots)
    full = np.asarray(whole.all(axis=(2, 3)))
    # Stand-ins of cut dots may lie in any cell, and in a ring of cells about the lattice.
    (cell_y, in_y), (cell_x, in_x) = (
        np.divmod(at - axis.first[0] + dots, dots) for at, axis in ((row, fine_up), (column, fine_across))
    )
    held = np.pad(~full & whole.any(axis=(2, 3)), 1)
    held[cell_y, cell_x] = True
    number = np.cumsum(held).reshape(held.shape)
    laid = np.where(whole & ~full[:, :, None, None], split_cells(layout.place, dots, dots), dots**2)
    laid = np.pad(laid, ((1, 1), (1, 1), (0, 0), (0, 0)), constant_values=dots**2)[held]
    cells = (
        np.concatenate([np.arange(dots**2), laid.ravel()]),
        (number[cell_y, cell_x] * dots + in_y) * dots + in_x,
        dot,
        weight,
    )
    matrix, reach = _to_merged(dots, x.dot_um, merged, highest, _MERGED_TOLERANCES[dtype])
    count, side = dots // merged, len(matrix)
    up, across = (
        _Axis.of(Lattice(each.start_um, each.cells, count, merged * each.dot_um, each.pitch_um), highest, reach + count)
        for each in (y, x)
    )
    # By the ring: what lies beside a cell on its lower side begins where the cell before it does.
    j, i = (np.concatenate([inside + 1, beside]) for inside, beside in zip(full.nonzero(), held.nonzero(), strict=True))
    rows, columns = (number[:, None] * count + np.arange(side) for number in (j, i))
    at = _place(up, across, rows[:, :, None], columns[:, None, :]).ravel()
    patches = split_cells(unit_dots(layout.turned, side), side, side)[full].ravel()
    sources = np.concatenate([patches, np.arange(side**2, (1 + len(laid)) * side**2)])
    nothing = np.full(4 * up.half * across.half, (1 + len(laid)) * side**2)
    home = nothing, at, sources, np.ones(at.size)
    return (
        Merged(
            Spread((1 + len(laid), dots, dots), *map(here, cells)),
            here(matrix),
            Spread((4, up.half, across.half), *map(here, home)),
        ),
        (up, across),
    )


def _to_merged(dots: int, dot_um: float, merged: int, highest: float, tolerance: float) -> tuple[Floats, int]:
    """Sources of a cell and so many to either side for its dots, [sources, dots], and how many."""
    count = dots // merged
    axis = _Axis(np.zeros(0), merged * dot_um, np.zeros(0, dtype=np.intp), 1)
    middles = (np.arange(merged) + 0.5) / merged - 0.5
    for reach in range(_FEWEST, _MOST + 1):
        place = np.arange(-reach, reach + 1)
        fits = [axis.fit(axis.width_um * (place - middle), dot_um, 1, highest) for middle in middles]
        if max(residual for _, residual in fits) <= tolerance:
            break
    matrix = np.zeros((count + 2 * reach, dots))
    for k in range(dots):
        source, own = divmod(k, merged)
        matrix[source : source + 2 * reach + 1, k] = fits[own][0][0]
    # A turned cell has its turned sources.
    return (matrix + matrix[::-1, ::-1]) / 2, reach


def _place(up: _Axis, across: _Axis, row: Indices, column: Indices) -> Indices:
    """Flat numbers of sources in their quadrants."""
    (below, y), (left, x) = up.folded(row), across.folded(column)
    return np.asarray(((2 * below + left) * up.half + y) * across.half + x)


def _of_whole(layout: Layout, up: _Axis, across: _Axis) -> Indices:
    """The dot at every source of whole dots, flat by quadrant; the number of dots where there is none."""
    whole = np.full(4 * up.half * across.half, layout.dots**2)
    row, column = np.nonzero(layout.pupil.whole)
    for j in range(up.parts):
        for i in range(across.parts):
            whole[_place(up, across, up.first[row] + j, across.first[column] + i)] = layout.place[row, column]
    return whole


@dataclass(frozen=True, eq=False)
class CellLags:
    """The autocorrelation of cells with gutters between them, by whole cells and whole dots; a function of the dots.

    Attributes:
        index: int64 [cells y, dots y, cells x, dots x], the unit's dot at each place.
        share: of each inside the stop.
        spread: [dots²], what lag 0 gains with the square of each dot over that of its mean.
    """

    index: torch.Tensor
    share: torch.Tensor
    spread: torch.Tensor
    sizes: tuple[int, ...]

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """Autocorrelation in dots, [..., cells y x dots y, cells x x dots x], negative lags wrapped round."""
        flat = unit.flatten(-2)
        laid = flat.index_select(-1, self.index.flatten()).view(*unit.shape[:-2], *self.index.shape) * self.share
        axes = (-4, -3, -2, -1)
        spectrum = torch.fft.rfftn(laid, s=self.sizes, dim=axes)
        table = torch.fft.irfftn(spectrum.real**2 + spectrum.imag**2, s=self.sizes, dim=axes)
        table = table.flatten(-2).flatten(-3, -2)
        first = torch.nn.functional.one_hot(table.new_zeros((), dtype=torch.int64), table[..., 0, :].shape[-1])
        added = (self.spread * flat**2).sum(-1)[..., None] * first
        return torch.cat([(table[..., 0, :] + added)[..., None, :], table[..., 1:, :]], -2)


Weighted = tuple[tuple[torch.Tensor, torch.Tensor], ...]
"""Places along an axis, and weights, whose sum interpolates a table."""


@dataclass(frozen=True, eq=False)
class Modulation:
    """The presampled MTF of one layout behind one camera at one wavelength, a function of the unit's dots.

    Attributes:
        rows, columns: of the lags of all frequencies.
        pixel: [rows, columns], the square pixel's own transfer.
    """

    table: Autocorrelation | CellLags
    rows: Weighted
    columns: Weighted
    pixel: torch.Tensor

    def __call__(self, unit: torch.Tensor) -> torch.Tensor:
        """The MTF [..., RINGS, 2 RINGS - 1] of units [..., dots, dots], from frequency 0 up and from side to side."""
        table = self.table(unit)
        rows = sum(weight[:, None] * table.index_select(-2, index) for index, weight in self.rows)
        assert isinstance(rows, torch.Tensor)
        values = sum(weight * rows.index_select(-1, index) for index, weight in self.columns)
        # An autocorrelation of no phase is nowhere below 0, but for rounding.
        return values * self.pixel / table[..., :1, :1]


def modulation(
    panel: Panel,
    camera: Camera,
    wavelength_nm: float,
    *,
    dtype: torch.dtype = torch.float64,
    device: str | torch.device = "cpu",
) -> Modulation:
    """The MTF of panels that are laid out like a given one; arguments as of :func:`point_image`."""
    camera = replace(camera, wavelengths_nm=(wavelength_nm,))
    layout, reach_um = Layout.of(panel, camera.stop), longest_lag_um(camera)
    x, y = layout.pupil.x, layout.pupil.y
    here = partial(_here, dtype=dtype, device=device)
    dots = np.ix_(y.dot_index().ravel(), x.dot_index().ravel())
    index, share = here(layout.place[dots]), here(layout.pupil.mean_transmission[dots])
    spread = here(layout.summed(layout.pupil.variance))
    table: Autocorrelation | CellLags
    if x.has_gutter:
        cells = (y.cells, y.dots, x.cells, x.dots)
        sizes = tuple(lag_sizes(x, y, reach_um))
        table, along_y, along_x = CellLags(index.view(cells), share.view(cells), spread, sizes), sizes[:2], sizes[2:]
    else:
        rows, columns = share.shape
        reach, wide = (min(int(reach_um / x.dot_um) + 1, count - 1) for count in (rows, columns))
        size, side = transform_size(max(rows, columns), max(reach, wide)), (layout.dots, layout.dots)
        table = Autocorrelation(index.flatten(), (rows, columns), layout.dots, size, reach, share, spread.view(side))
        along_y = along_x = (size, 1)
    axis = 0.5 / (RINGS - 1) * np.arange(1 - RINGS, RINGS, dtype=np.float64)
    lag = reach_um * 2 * axis

    def weighted(lattice: Lattice, lags: Floats, sizes: tuple[int, ...]) -> Weighted:
        return tuple(
            (here(np.broadcast_to(place, lags.shape)), here(weight))
            for place, weight in neighbours(lattice, lags, (sizes[0], sizes[1]))
        )

    pixel = here(np.sinc(axis[RINGS - 1 :, None]) * np.sinc(axis))
    return Modulation(table, weighted(y, lag[RINGS - 1 :], along_y), weighted(x, lag, along_x), pixel)
