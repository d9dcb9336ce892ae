r"""The field of all cells that lie whole inside the stop, from the field of one of them, and its adjoint.

A dot at Y + b, in a cell whose middle is at Y, has the waves

    cos(Y + b) = cos Y cos b - sin Y sin b,    sin(Y + b) = sin Y cos b + cos Y sin b     (each angle times 2πv),

so a field is made of the even and odd parts E_kl of one cell's field, times sums of waves over the cells' middles.
Orientations differ by transposing the unit and by signs of E_kl. With t = 0 for the unit and 1 for its transpose,

    F_ij(u, v) = Σ_tkl T_ij,tkl(u, v) E_tkl(u, v),    i, j, k, l even or odd,

T being constants of the layout: 32 multiplications for each frequency, however many cells and dots there are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.model import ORIENTATIONS, orient
from maskfab.optics.pupil.aperture import Lattice
from maskfab.optics.torch.phasors import cosines_and_sines

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class WholeCells:
    """The constants of the cells that are whole.

    Attributes:
        along_y: [2, nv, dots], even and odd waves over the unit's rows.
        along_x: [2, dots, nu], the same over its columns.
        tables: [2 x 2 x 2, 2, 2, nv, nu], T by t, k, l and then by i, j.
    """

    along_y: torch.Tensor
    along_x: torch.Tensor
    tables: torch.Tensor

    def field(self, unit: torch.Tensor) -> torch.Tensor:
        """Even and odd parts of the field, [2, 2, nv, nu], of a unit [dots, dots]."""
        parts = self.tables.new_empty(self.tables.shape[1:])
        number = 0
        for turned in (unit, unit.mT):
            for along_y in self.along_y:
                rows = along_y @ turned
                for along_x in self.along_x:
                    cell = rows @ along_x
                    if number:
                        parts.addcmul_(self.tables[number], cell)
                    else:
                        torch.mul(self.tables[number], cell, out=parts)
                    number += 1
        return parts

    def adjoint(self, slope: torch.Tensor) -> torch.Tensor:
        """Derivative by the unit, [dots, dots], from that by the field's parts, [2, 2, nv, nu]."""
        by_turned = self.along_y.new_zeros(2, self.along_y.shape[2], self.along_x.shape[1])
        flat = slope.flatten(0, 1)
        for number, table in enumerate(self.tables.flatten(1, 2)):
            turned, odd_y, odd_x = number // 4, number // 2 % 2, number % 2
            cell = table[0] * flat[0]
            for k in range(1, 4):
                cell.addcmul_(table[k], flat[k])
            by_turned[turned].addmm_(self.along_y[odd_y].mT, cell @ self.along_x[odd_x].mT)
        return by_turned[0] + by_turned[1].mT


def waves(position_um: Floats, dot_um: float, frequency: Floats) -> Floats:
    """Even and odd transforms of dots with their middles at these positions, [2, n, m]."""
    both = cosines_and_sines(position_um, frequency)
    both *= dot_um * np.sinc(dot_um * frequency)
    return both


def cell_tables(
    y: Lattice, x: Lattice, chosen: NDArray[np.int8], v: Floats, u: Floats, dtype: torch.dtype = torch.float64
) -> torch.Tensor:
    """T of :class:`WholeCells`.

    Args:
        y, x: the cells' lattices.
        chosen: int8 [rows, columns], elements of D4; -1 where a cell is not whole.
        v, u: frequencies in cycles per micrometre.
        dtype: of the tables; sums are double in any case.
    """
    at_y, at_x = (cosines_and_sines(_middle_um(lattice), f) for lattice, f in ((y, v), (x, u)))
    # The waves of the middles that turn part k of a cell into part i of the field: a sign and cos or sin.
    sign, wave = np.array([[1.0, -1.0], [1.0, 1.0]]), np.array([[0, 1], [1, 0]])
    tables = torch.empty(2, 2, 2, 2, 2, v.size, u.size, dtype=dtype)
    elements = [_as_flips(k) for k in range(ORIENTATIONS)]
    for turned in range(2):
        for k in range(2):
            for l in range(2):  # noqa: E741 -- the module's own letter
                count = np.zeros(chosen.shape)
                for number, (transposed, flip_y, flip_x) in enumerate(elements):
                    if transposed == turned:
                        count[chosen == number] = (-1.0) ** (k * flip_y + l * flip_x)
                for i in range(2):
                    rows = sign[i, k] * (at_y[wave[i, k]].T @ count)
                    for j in range(2):
                        product = (sign[j, l] * rows) @ at_x[wave[j, l]]
                        tables[turned, k, l, i, j] = torch.from_numpy(product)
    return tables.view(8, 2, 2, v.size, u.size)


def unit_waves(lattice: Lattice, frequency: Floats) -> Floats:
    """Waves over the dots of one cell about its middle, [2, dots, m]."""
    offset = (np.arange(lattice.dots, dtype=np.float64) - (lattice.dots - 1) / 2) * lattice.dot_um
    return waves(offset, lattice.dot_um, frequency)


def _middle_um(lattice: Lattice) -> Floats:
    middle: Floats = lattice.start_um + lattice.pitch_um * np.arange(lattice.cells, dtype=np.float64)
    return middle + lattice.dots * lattice.dot_um / 2


def _as_flips(element: int) -> tuple[int, int, int]:
    """Whether an element transposes the cell first, then whether it flips y, then x."""
    index = np.arange(4).reshape(2, 2)
    wanted = orient(index, element)
    for transposed, start in enumerate((index, index.T)):
        for flip_y, rows in enumerate((start, start[::-1])):
            for flip_x, cell in enumerate((rows, rows[:, ::-1])):
                if np.array_equal(cell, wanted):
                    return transposed, flip_y, flip_x
    raise AssertionError(element)
