"""The error of photographs behind units of 7 dots, which several files judge their layouts by."""

from __future__ import annotations

import pytest

from maskfab.design.pupil_error import PupilError, pupil_error
from maskfab.design.surrogate import Surrogate, surrogate
from maskfab.imaging.scenes import dead_leaves


@pytest.fixture(scope="session")
def estimate() -> Surrogate:
    return surrogate([dead_leaves(1)], 7)


@pytest.fixture(scope="session")
def error(estimate: Surrogate) -> PupilError:
    return pupil_error(estimate, (24, 40))
