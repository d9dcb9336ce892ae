"""Current densities and lives against the closed form's table."""

from __future__ import annotations

import pytest

from maskfab.display.drive import LightDemand, current_density, relative_life


@pytest.mark.parametrize(
    ("area", "expected"),
    [(0.05, (4.7, 6.5, 9.0)), (0.08, (3.0, 4.1, 5.6)), (0.12, (2.0, 2.7, 3.8)), (0.18, (1.3, 1.8, 2.5))],
)
def test_density(area: float, expected: tuple[float, float, float]) -> None:
    assert current_density(LightDemand(), (area, area, area)) == pytest.approx(expected, abs=0.051)


@pytest.mark.parametrize(("area", "lives"), [(0.05, (0.15, 0.10, 0.08)), (0.12, (0.54, 0.48, 0.44))])
def test_life(area: float, lives: tuple[float, float, float]) -> None:
    found = [relative_life(1 / area, 1 / 0.18, n) for n in (1.5, 1.8, 2.0)]
    assert found == pytest.approx(lives, abs=0.0051)


def test_vendor_claim_gives_three_lives() -> None:
    assert relative_life(1 / 60, 1 / 28) == pytest.approx(3, rel=2e-3)
