"""Estimates of photographs behind units of chosen cells."""

from __future__ import annotations

from collections.abc import Sequence

from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import F1, PhotoCamera, lattice
from maskfab.designs.model.expected_psnr import Surrogate, surrogate_behind
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings


def surrogate(
    scenes: Sequence[Photograph],
    dots: int = 21,
    *,
    dot_nm: int | None = None,
    camera: PhotoCamera = F1,
    settings: CaptureSettings = F1_SETTINGS,
) -> Surrogate:
    """For units of so many dots a side, in cells of 168 um unless the dots' width is given."""
    return surrogate_behind(scenes, lattice(dots, dot_nm, camera=camera), settings=settings)
