r"""Diffraction orders of a periodic panel, in closed form from the transform of one cell.

A periodic panel of pitch T sends the share

    η_mn = |M(m/T, n/T)|² / T⁴                                   (Goodman, Fourier Optics, 4.4.3, for any cell)

of the light that falls on it into the order (m, n), M being the transform of one cell's amplitude. Over all orders
this adds up to the open ratio (Parseval), so η_mn over the open ratio is the share of the transmitted light. The
wavelength only sets where an order goes, to (m, n) λf / T on the sensor, not how strong it is.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import InternalError, JobError
from maskfab.model import Panel, Quantity, Stop
from maskfab.optics.field.parity import direct_field
from maskfab.optics.pupil.aperture import panel_aperture
from maskfab.optics.pupil.pupil import cut


def order_efficiencies(panel: Panel, highest: int) -> Floats:
    """η_mn as shares of the incident light, [2 h + 1, 2 h + 1] over n and m from -h to h.

    Args:
        panel: all its cells in one orientation.
        highest: largest |m| and |n|, at least 0.

    Raises:
        JobError: MF104 for a negative order.
        InternalError: MF901 if the cells differ in orientation, for then there are no such orders.
    """
    if highest < 0:
        raise JobError("MF104", f"the highest order {highest} is negative", cure="Give 0 or more")
    if (panel.orientations != panel.orientations[0, 0]).any():
        raise InternalError("MF901", "diffraction orders were asked of a panel whose cells differ in orientation")
    cell = replace(panel, orientations=panel.orientations[:1, :1])
    pitch = panel.cell_size.pitch_um
    frequency = np.arange(-highest, highest + 1, dtype=np.float64) / pitch
    field = direct_field(cut(panel_aperture(cell), Stop("square", pitch)), frequency, frequency)
    return np.asarray(abs(field) ** 2 / pitch**4)


def order_quantities(panel: Panel, die: str | None = None) -> tuple[Quantity, ...]:
    """The zero order and the sum of the lowest five, each as a share of the incident and of the transmitted light.

    Raises:
        InternalError: MF901 if the cells differ in orientation.
    """
    share = order_efficiencies(panel, 1)
    zero = float(share[1, 1])
    five = zero + float(share[0, 1] + share[2, 1] + share[1, 0] + share[1, 2])
    rounding = 1e-12
    named = (
        ("order_zero", zero, "zero order"),
        ("orders_lowest_five", five, "orders (0,0), (±1,0) and (0,±1)"),
    )
    found = []
    for name, value, what in named:
        for light, whole in (("incident", 1.0), ("transmitted", panel.open_ratio)):
            found.append(
                Quantity(
                    f"{name}_{light}",
                    value / whole,
                    f"{what} of the periodic panel as a share of the {light} light, |M(m/T, n/T)|²/T⁴ from the cell's "
                    "transform",
                    uncertainty=rounding,
                    die=die,
                )
            )
    return tuple(found)
