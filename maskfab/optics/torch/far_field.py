r"""Intensity of a tiled unit opening and its gradient, for optimisers: real parts, even and odd, in torch.

All copies of a unit share its dots, so the intensity of a whole pupil is a function of dots x dots numbers. With the
real kernels

    K_e(x, u) = w sinc(uw) cos(2πux),    K_o(x, u) = w sinc(uw) sin(2πux)        (as in field.py, order 0)

the field has the parts F_ij = K_i(y, v)ᵀ P K_j(x, u), even and odd in v and u, and the intensities at (u, v) and at
(-u, v) are

    I_same = (F_ee - F_oo)² + (F_oe + F_eo)²,    I_opposite = (F_ee + F_oo)² + (F_oe - F_eo)².

Cells inside the stop are turned copies of one, whose field is known from its few dots (torch_cells.py). Only the dots
about the stop's edge, which cut cells have or lack, go through products of their own (torch_rim.py).

The adjoint is written by hand: derivatives G of a loss by the intensities become derivatives by the parts, for instance
∂/∂F_ee = 2 G_same (F_ee - F_oo) + 2 G_opposite (F_ee + F_oo), and the same products transposed carry them home to the
dots. It costs what the transform costs, and four arrays of the quadrant are all that is kept for it.

Notes:
    Dots cut by the stop enter grey, with the share of them that is inside: their shape is left out. For a 4 mm stop on
    8 µm dots that moves a PSF window of 256 µm by 1e-4 (relative L2). field.py integrates the rim exactly.
    Kernels are worked out in float64 with phases reduced to half a cycle, then rounded. In float32 the intensity is
    good to 1e-6 (relative L2) with products in full float32; leave TF32 switched off.
    On CUDA the scatter-add adds in any order, so gradients there repeat to rounding only; on the CPU they repeat.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.errors import InternalError
from maskfab.model import ORIENTATIONS, Panel, Stop, unit_dots
from maskfab.optics.pupil.aperture import Lattice, panel_lattices
from maskfab.optics.pupil.pupil import share_inside
from maskfab.optics.torch.cell_field import WholeCells, cell_tables, unit_waves
from maskfab.optics.torch.rim_field import Rim, rim

Floats = NDArray[np.float64]

_ROUNDING = 1e-12  # of the share of a dot that is inside


@dataclass(frozen=True, eq=False)
class TiledField:
    """The constants of one panel, stop and grid of frequencies; a function of the unit's dots.

    Attributes:
        whole: the cells inside the stop, with those that are mostly inside.
        rim: the dots that this leaves out or has too many; None if there are none.
        area_um2: [dots, dots], area inside the stop of all copies of each dot.
        on_axis: whether the first u and the first v are 0.
    """

    whole: WholeCells
    rim: Rim | None
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
        here = unit.to(device=self.area_um2.device, dtype=self.area_um2.dtype)
        quadrants: torch.Tensor = _Intensity.apply(here, self)  # type: ignore[no-untyped-call]
        return quadrants

    def energy(self, unit: torch.Tensor) -> torch.Tensor:
        """Transmitted energy in µm², a scalar: what normalises a PSF, I / ((λf)² energy)."""
        here = unit.to(device=self.area_um2.device, dtype=self.area_um2.dtype)
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
        InternalError: MF901 for a negative frequency, for one axis on 0 and the other not, for another dtype, or for a
            panel of several openings.
    """
    if min(u.min(), v.min()) < 0 or (u[0] == 0) != (v[0] == 0):
        raise InternalError("MF901", "frequencies must not be negative, and begin at 0 along both axes or neither")
    if dtype not in (torch.float32, torch.float64):
        raise InternalError("MF901", f"a field is float32 or float64, not {dtype}")
    if device is None:
        device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    reach = stop.diameter_um / 2
    x, y = (lattice.trimmed(reach) for lattice in panel_lattices(panel))
    chosen = _kept_cells(panel, x, y)
    if chosen.max() >= ORIENTATIONS:
        raise InternalError("MF901", "a tiled field is a function of one opening; the panel has several")
    dots = panel.opening.dots
    unit_dot = unit_dots(chosen, dots)
    share = share_inside(x, y, stop)[np.ix_(y.dot_index().ravel(), x.dot_index().ravel())]
    cells = share.reshape(y.cells, dots, x.cells, dots)
    # A cell that is mostly inside counts as whole, and what it lacks counts negative: that leaves a thinner ring.
    whole = cells.mean(axis=(1, 3)) > 0.5
    cells -= whole[:, None, :, None]
    left = cells.reshape(share.shape)
    left[np.abs(left) < _ROUNDING] = 0.0
    ring = np.nonzero(left)
    # A whole cell has every dot once.
    copies = np.bincount(unit_dot[ring], left[ring], dots * dots).reshape(dots, dots) + np.count_nonzero(whole)
    along_y, along_x = unit_waves(y, v), unit_waves(x, u)

    def there(array: NDArray[np.floating[Any]]) -> torch.Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(device=device, dtype=dtype)

    return TiledField(
        whole=WholeCells(
            along_y=there(along_y.transpose(0, 2, 1)),
            along_x=there(along_x),
            tables=cell_tables(y, x, np.where(whole, chosen, -1), v, u, dtype).to(device),
        ),
        rim=rim(y, x, unit_dot, left, v, u, dtype=dtype, device=device),
        area_um2=there(copies * x.dot_um * y.dot_um),
        on_axis=bool(u[0] == 0),
    )


class _Intensity(torch.autograd.Function):
    """The intensity of two quadrants, with its adjoint."""

    @staticmethod
    def forward(ctx: Any, unit: torch.Tensor, field: TiledField) -> torch.Tensor:
        parts = field.whole.field(unit)
        if field.rim is not None:
            field.rim.add_field(unit, parts)
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
        dots = field.whole.adjoint(parts).flatten()
        if field.rim is not None:
            dots.scatter_add_(0, field.rim.index, field.rim.adjoint(parts))
        return dots.mul_(2).view(ctx.shape), None


def _kept_cells(panel: Panel, x: Lattice, y: Lattice) -> NDArray[np.int8]:
    """Orientations of the cells that the lattices have kept."""
    whole_x, whole_y = panel_lattices(panel)
    column = round((x.start_um - whole_x.start_um) / x.pitch_um)
    row = round((y.start_um - whole_y.start_um) / y.pitch_um)
    return panel.orientations[row : row + y.cells, column : column + x.cells]
