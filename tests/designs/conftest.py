"""The error of photographs behind units of 7 dots, which several files judge their layouts by."""

from __future__ import annotations

import pytest
from estimates import surrogate
from once import leaves

from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.designs.model.panel_error import PupilError, pupil_error


@pytest.fixture(scope="session")
def estimate() -> Surrogate:
    return surrogate([leaves(1)], 7)


@pytest.fixture(scope="session")
def error(estimate: Surrogate) -> PupilError:
    return pupil_error(estimate, (24, 40))


@pytest.fixture(scope="session")
def coarse() -> PupilError:
    """At one level, of 12 x 12 cells of 336 um: a map of them is designed in a fraction of the time."""
    return pupil_error(surrogate([leaves(1)], 7, dot_nm=48_000), (32,))
