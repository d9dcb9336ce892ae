"""The error of photographs behind units of 7 dots, which several files judge their layouts by."""

from __future__ import annotations

import pytest

from maskfab.camera.scenes import dead_leaves
from maskfab.design.model.expected_psnr import Surrogate, surrogate
from maskfab.design.model.layout_error import PupilError, pupil_error


@pytest.fixture(scope="session")
def estimate() -> Surrogate:
    return surrogate([dead_leaves(1)], 7)


@pytest.fixture(scope="session")
def error(estimate: Surrogate) -> PupilError:
    return pupil_error(estimate, (24, 40))
