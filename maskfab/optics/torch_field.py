r"""Intensity of a tiled unit opening and its gradient, for optimisers: a parity-split matrix transform in torch.

All copies of a unit share its dots, so the intensity of a whole pupil is a function of dots x dots numbers. With the
pupil folded about both axes into parts even and odd in y and x, P_ee, P_eo, P_oe, P_oo, and the real kernels

    K_e(x, u) = w sinc(uw) cos(2πux),    K_o(x, u) = w sinc(uw) sin(2πux)        (as in field.py, order 0)

the field's parts are F_ij = K_i(y, v)ᵀ P_ij K_j(x, u), and the intensities at (u, v) and at (-u, v) are

    I_same = (F_ee - F_oo)² + (F_oe + F_eo)²,    I_opposite = (F_ee + F_oo)² + (F_oe - F_eo)².

A PSF's window is narrow beside the whole far field of a dot, so the kernels have few singular values above rounding:
about twice the cycles that the highest frequency has between axis and rim. Through these, V W = K, the products are
two thin pairs, Wᵀ (Vᵀ P V) W.

The adjoint is written by hand: derivatives G of a loss by the intensities become derivatives by the parts, for instance
∂/∂F_ee = 2 G_same (F_ee - F_oo) + 2 G_opposite (F_ee + F_oo), the same products transposed carry them to the folded
pupil, the fold is its own transpose, and a scatter-add brings them home to the dots. It costs what the transform costs,
and four arrays of the quadrant are all that is kept for it.

Notes:
    Dots cut by the stop enter grey, with the share of them that is inside: their shape is left out. For a 4 mm stop on
    8 µm dots that moves a PSF window of 256 µm by 1e-4 (relative L2). field.py integrates the rim exactly.
    Kernels are worked out in float64 with phases reduced to half a cycle, then rounded. In float32 the intensity is
    good to 1e-6 (relative L2) with products in full float32; leave TF32 switched off.
    On CUDA the scatter-add adds in any order, so gradients there repeat to rounding only; on the CPU they repeat.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.model import ORIENTATIONS, Panel, Stop, orient
from maskfab.optics.aperture import Aperture, Lattice, panel_lattices
from maskfab.optics.pupil import cut

Floats = NDArray[np.float64]

# Singular values below these shares of the largest are left out of the kernels; they are far below rounding.
_RANK_TOLERANCE: Mapping[torch.dtype, float] = MappingProxyType({torch.float32: 1e-8, torch.float64: 1e-14})


@dataclass(frozen=True, eq=False)
class TiledField:
    """The constants of one panel, stop and grid of frequencies; a function of the unit's dots.

    Attributes:
        index: int64 [2 x 2 x rows x columns], the unit's dot at each place of the four quadrants of the pupil, flat:
            upper and lower, right and left, all laid from the axis outwards.
        weight: [2, 2, rows, columns], share of each of these dots inside the stop; halved on a middle row or column,
            which two quadrants have in common.
        stages: one or two pairs of factors of the kernels, even and odd, in the order of use; in each pair
            [2, ., rows] works along y from the left and [2, columns, .] along x from the right.
        area_um2: [dots, dots], area inside the stop of all copies of each dot.
        on_axis: whether the first u and the first v are 0.
    """

    index: torch.Tensor
    weight: torch.Tensor
    stages: tuple[tuple[torch.Tensor, torch.Tensor], ...]
    area_um2: torch.Tensor
    on_axis: bool

    def intensity(self, unit: torch.Tensor) -> torch.Tensor:
        """|F|² in µm⁴ on the quadrant u, v >= 0 and on its mirror image, [2, nv, nu]: at (u, v) and at (-u, v).

        The other two quadrants are equal to these, turned by half a turn. Differentiable once.

        Args:
            unit: amplitude of the unit's dots, [dots, dots], real; it is brought to this field's type and device.

        Raises:
            InternalError: MF901 if the unit has another shape.
        """
        if unit.shape != self.area_um2.shape:
            raise InternalError("MF901", f"the unit is {tuple(unit.shape)}, the field's {tuple(self.area_um2.shape)}")
        here = unit.to(device=self.weight.device, dtype=self.weight.dtype)
        quadrants: torch.Tensor = _Intensity.apply(here, self)  # type: ignore[no-untyped-call]
        return quadrants

    def energy(self, unit: torch.Tensor) -> torch.Tensor:
        """Transmitted energy in µm², a scalar: what normalises a PSF, I / ((λf)² energy)."""
        here = unit.to(device=self.weight.device, dtype=self.weight.dtype)
        return (self.area_um2 * here**2).sum()

    def plane(self, quadrants: torch.Tensor) -> torch.Tensor:
        """The two quadrants laid out on the symmetric grid, [2 nv - 1, 2 nu - 1], or [2 nv, 2 nu] off axis."""
        first = 1 if self.on_axis else 0
        same, opposite = quadrants[0], quadrants[1]
        upper = torch.cat([opposite[:, first:].flip(1), same], dim=1)
        lower = torch.cat([same[first:, first:].flip(0, 1), opposite[first:].flip(0)], dim=1)
        return torch.cat([lower, upper], dim=0)


def tiled_field(
    panel: Panel,
    stop: Stop,
    u: Floats,
    v: Floats,
    *,
    dtype: torch.dtype = torch.float64,
    device: torch.device | None = None,
) -> TiledField:
    """The field of a panel behind a stop, as a function of its unit opening; the panel's own opening is not looked at.

    Args:
        panel: dots, pitch, gutters and orientations; centred on the axis.
        stop: lens stop.
        u, v: non-negative frequencies in cycles per micrometre, [nu] and [nv]; both begin at 0 or neither does.
        dtype: float32 or float64.
        device: where it is computed; by default CUDA if there is any, else the CPU.

    Raises:
        InternalError: MF901 for a negative frequency, for one axis on 0 and the other not, or for another dtype.
    """
    if min(u.min(), v.min()) < 0 or (u[0] == 0) != (v[0] == 0):
        raise InternalError("MF901", "frequencies must not be negative, and begin at 0 along both axes or neither")
    if dtype not in _RANK_TOLERANCE:
        raise InternalError("MF901", f"a field is float32 or float64, not {dtype}")
    if device is None:
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    reach = stop.diameter_um / 2
    x, y = (lattice.trimmed(reach) for lattice in panel_lattices(panel))
    unit_dot, share = _unit_dots(panel, x, y), _share_inside(x, y, stop)
    dots = panel.opening.dots
    area = np.bincount(unit_dot.ravel(), share.ravel(), dots * dots).reshape(dots, dots) * x.dot_um * y.dot_um
    rows, columns = _folds(y), _folds(x)
    places = [np.ix_(row, column) for row in rows for column in columns]
    halved = _middle_halved(y)[:, None] * _middle_halved(x)

    def there(array: NDArray[Any], kind: torch.dtype) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device=device, dtype=kind)

    return TiledField(
        index=there(np.stack([unit_dot[place] for place in places]).ravel(), torch.int64),
        weight=there(np.stack([share[place] * halved for place in places]).reshape(2, 2, *halved.shape), dtype),
        stages=tuple(
            (there(along_y.transpose(0, 2, 1), dtype), there(along_x, dtype))
            for along_y, along_x in _stages(_kernels(y, v), _kernels(x, u), _RANK_TOLERANCE[dtype])
        ),
        area_um2=there(area, dtype),
        on_axis=bool(u[0] == 0),
    )


class _Intensity(torch.autograd.Function):
    """The intensity of two quadrants, with its adjoint."""

    @staticmethod
    def forward(ctx: Any, unit: torch.Tensor, field: TiledField) -> torch.Tensor:
        parts = _butterfly(unit.flatten().index_select(0, field.index).view(field.weight.shape).mul_(field.weight))
        for along_y, along_x in field.stages:
            parts = _products(along_y, parts, along_x)
        (even_even, even_odd), (odd_even, odd_odd) = parts
        real = torch.stack([even_even - odd_odd, even_even + odd_odd])
        imaginary = torch.stack([odd_even + even_odd, odd_even - even_odd])
        ctx.field, ctx.shape = field, unit.shape
        ctx.save_for_backward(real, imaginary)
        return torch.addcmul(real * real, imaginary, imaginary)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, slope: torch.Tensor) -> tuple[torch.Tensor, None]:
        field: TiledField = ctx.field
        real, imaginary = (part * slope for part in ctx.saved_tensors)
        parts = slope.new_empty(2, 2, *slope.shape[1:])
        torch.add(real[1], real[0], out=parts[0, 0])
        torch.sub(imaginary[0], imaginary[1], out=parts[0, 1])
        torch.add(imaginary[0], imaginary[1], out=parts[1, 0])
        torch.sub(real[1], real[0], out=parts[1, 1])
        for along_y, along_x in reversed(field.stages):
            parts = _products(along_y.mT, parts, along_x.mT)
        laid = _butterfly(parts).mul_(field.weight)
        dots = torch.zeros(ctx.shape.numel(), dtype=laid.dtype, device=laid.device)
        dots.scatter_add_(0, field.index, laid.flatten())
        return dots.mul_(2).view(ctx.shape), None


def _products(along_y: torch.Tensor, parts: torch.Tensor, along_x: torch.Tensor) -> torch.Tensor:
    """The matrix products of all four parities, [2, 2, m, n]."""
    out = parts.new_empty(2, 2, along_y.shape[1], along_x.shape[2])
    # One by one: a broadcast product would first copy the kernels for every parity.
    for odd_y in range(2):
        for odd_x in range(2):
            torch.mm(along_y[odd_y] @ parts[odd_y, odd_x], along_x[odd_x], out=out[odd_y, odd_x])
    return out


def _butterfly(quadrants: torch.Tensor) -> torch.Tensor:
    """Sums and differences along the two leading axes, [2, 2, ...]: quadrants to parities, or back in the adjoint."""
    vertical, both = torch.empty_like(quadrants), torch.empty_like(quadrants)
    torch.add(quadrants[0], quadrants[1], out=vertical[0])
    torch.sub(quadrants[0], quadrants[1], out=vertical[1])
    torch.add(vertical[:, 0], vertical[:, 1], out=both[:, 0])
    torch.sub(vertical[:, 0], vertical[:, 1], out=both[:, 1])
    return both


def _stages(along_y: Floats, along_x: Floats, tolerance: float) -> list[tuple[Floats, Floats]]:
    """The kernels along y and x, [2, dots, m] each, as they are, or as two thin pairs if that is less work."""
    (wide_y, narrow_y), (wide_x, narrow_x) = _factors(along_y, tolerance), _factors(along_x, tolerance)

    def work(stages: list[tuple[Floats, Floats]]) -> int:
        total = 0
        for of_y, of_x in stages:
            (rows, few_rows), (columns, few_columns) = of_y.shape[1:], of_x.shape[1:]
            total += few_rows * columns * (rows + few_columns)
        return total

    direct, thin = [(along_y, along_x)], [(wide_y, wide_x), (narrow_y, narrow_x)]
    return min(direct, thin, key=work)


def _factors(kernels: Floats, tolerance: float) -> tuple[Floats, Floats]:
    """V [2, dots, r] and W [2, r, m] with V W = kernels, r being the larger rank of the two parities."""
    left, size, right = np.linalg.svd(kernels, full_matrices=False)
    rank = max(1, int((size > tolerance * size.max()).sum(axis=1).max()))
    root = np.sqrt(size[:, :rank])
    return left[:, :, :rank] * root[:, None, :], root[:, :, None] * right[:, :rank]


def _unit_dots(panel: Panel, x: Lattice, y: Lattice) -> NDArray[np.intp]:
    """Flat index into the unit of every dot of the cells that the lattices have kept, [dots y, dots x]."""
    whole_x, whole_y = panel_lattices(panel)
    column = round((x.start_um - whole_x.start_um) / x.pitch_um)
    row = round((y.start_um - whole_y.start_um) / y.pitch_um)
    chosen = panel.orientations[row : row + y.cells, column : column + x.cells]
    dots = panel.opening.dots
    index = np.arange(dots * dots).reshape(dots, dots)
    oriented = np.stack([orient(index, element) for element in range(ORIENTATIONS)])
    return oriented[chosen].transpose(0, 2, 1, 3).reshape(y.cells * dots, x.cells * dots)


def _share_inside(x: Lattice, y: Lattice, stop: Stop) -> Floats:
    """Share of every dot's area that lies inside the stop, [dots y, dots x]."""
    clear = np.ones((y.edges_um().size - 1, x.edges_um().size - 1))
    pupil = cut(Aperture(x, y, clear, np.zeros_like(clear)), stop)
    share: Floats = pupil.mean_transmission[np.ix_(y.dot_index().ravel(), x.dot_index().ravel())]
    return share


def _folds(lattice: Lattice) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Dot numbers from the axis outwards, and those of their mirror images."""
    count = lattice.cells * lattice.dots
    outwards = np.arange(count // 2, count)
    return outwards, count - 1 - outwards


def _middle_halved(lattice: Lattice) -> Floats:
    count = lattice.cells * lattice.dots
    factor = np.ones(count - count // 2)
    factor[0] = 0.5 if count % 2 else 1.0
    return factor


def _kernels(lattice: Lattice, frequency: Floats) -> Floats:
    """Even and odd transforms of the dots from the axis outwards, [2, dots, m]."""
    outwards, _ = _folds(lattice)
    lower = lattice.edges_um()[lattice.dot_index().ravel()[outwards]]
    cycles = (lower + lattice.dot_um / 2)[:, None] * frequency
    phase = 2 * np.pi * (cycles - np.rint(cycles))
    size = lattice.dot_um * np.sinc(lattice.dot_um * frequency)
    return np.stack([np.cos(phase), np.sin(phase)]) * size
