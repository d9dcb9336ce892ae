"""What the stop leaves of a panel: its dots' moments, and what working them out costs."""

from __future__ import annotations

import time

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss, legvander
from optics_cases import noise, panel
from scipy.special import gamma

from maskfab.job.camera import Stop
from maskfab.optics.pupil import RIM_ORDERS, cut, panel_aperture


@pytest.mark.parametrize(("diameter_um", "dot_nm"), [(4000.0, 8000), (90.0, 8000), (31.0, 9000), (700.0, 50_000)])
def test_monomials_over_the_disc_are_summed_from_the_dots(diameter_um: float, dot_nm: int) -> None:
    """∫ x^a y^b over a disc of radius R is R^(a+b+2) Γ((a+1)/2) Γ((b+1)/2) / Γ((a+b)/2 + 2)."""
    cells = 2 * int(np.ceil(diameter_um / dot_nm * 1e3 / 6)) + 2
    clear = panel(np.ones((3, 3), dtype=np.bool_), dot_nm=dot_nm, cells=cells)
    pupil = cut(panel_aperture(clear), Stop("circle", diameter_um))
    nodes, weights = leggauss(RIM_ORDERS)
    basis = legvander(nodes, RIM_ORDERS - 1) * weights[:, None] / 2
    for a, b in ((0, 0), (2, 0), (2, 4), (8, 0), (0, 8), (4, 4)):
        sides = []
        for edges, power in ((pupil.x.edges_um(), a), (pupil.y.edges_um(), b)):
            middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
            values = (middle[:, None] + width[:, None] / 2 * nodes) ** power * width[:, None]
            sides.append(values @ basis * (2 * np.arange(RIM_ORDERS) + 1))
        x, y = sides
        held = y[:, 0] @ pupil.whole @ x[:, 0]
        rim = np.einsum("kq,kqp,kp", y[pupil.rim_row], pupil.rim_moments, x[pupil.rim_column])
        exact = (diameter_um / 2) ** (a + b + 2) * gamma((a + 1) / 2) * gamma((b + 1) / 2) / gamma((a + b) / 2 + 2)
        assert held + rim == pytest.approx(exact, rel=2e-13)


def test_cutting_a_panel_costs_little_beside_the_field() -> None:
    """Hardly more than a product of 512 x 512 matrices, the field's own size: slices between the rim take none."""
    aperture, stop = panel_aperture(panel(noise(21, 0.2, 1), cells=24, seed=2)), Stop("circle", 4000.0)
    square = np.random.default_rng(0).random((512, 512))
    spent = []
    for _ in range(9):
        start = time.process_time()
        cut(aperture, stop)
        between = time.process_time()
        square @ square
        spent.append((between - start, time.process_time() - between))
    ours, products = np.median(spent, axis=0)
    assert ours < 1.4 * products
