"""Inputs of the golden set's cases: data in ``golden_jobs/``, shipped folders, and pictures drawn from fixed seeds."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO
import tifffile
from numpy.typing import NDArray

TESTS = Path(__file__).resolve().parent
ROOT = TESTS.parent


def lay(name: str, folder: Path) -> None:
    """Lay an input into a folder: a shipped folder, a set of ``golden_jobs/`` or what a function here draws."""
    if name in _DRAWN:
        _DRAWN[name](folder)
    elif (TESTS / "golden_jobs" / name).is_file():
        shutil.copy(TESTS / "golden_jobs" / name, folder)
    else:
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))


def _photographs(folder: Path) -> None:
    _leaves(folder, 832, 832)


def _large_photographs(folder: Path) -> None:
    _leaves(folder, 1024, 1536)


def _leaves(folder: Path, rows: int, columns: int) -> None:
    """A photograph of discs of all sizes, one over the other, as fallen leaves lie."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:rows, :columns]
    light = np.zeros((rows, columns, 3))
    for radius in 4 + 8 * rng.pareto(1.5, 400):
        row, column = rows * rng.random(), columns * rng.random()
        light[(y - row) ** 2 + (x - column) ** 2 < radius**2] = rng.random(3)
    (folder / "photographs").mkdir()
    tifffile.imwrite(folder / "photographs" / "leaves.tif", np.rint(255 * light).astype(np.uint8), photometric="rgb")


def _exposures(folder: Path) -> None:
    """Three exposures, 1, 8 and 64 ms, of a point light behind the die whose PSF an earlier case has written."""
    rng = np.random.default_rng(1)
    psf = OpenImageIO.ImageBuf(str(folder / "seen" / "psf_pixel_530nm.exr")).get_pixels()[..., 0].astype(float)
    light = 100 * psf / psf.max()
    for milliseconds in (1, 8, 64):
        electrons = rng.poisson(light * milliseconds) + 4.87 * rng.standard_normal(light.shape)
        _write(folder / f"{milliseconds}ms.tif", np.clip(electrons / 1.7 + 64, 0, 8190))


def _edge(folder: Path) -> None:
    """A slanted edge, blurred by a Gaussian, on a grid of one colour."""
    rng = np.random.default_rng(5)
    y, x = np.mgrid[:260, :120] - np.array([129.5, 59.5])[:, None, None]
    distance = x * np.cos(np.radians(5)) + y * np.sin(np.radians(5))
    light = 0.1 + 0.9 / (1 + np.exp(-distance / 0.6))
    _write(folder / "edge.tif", 500 + 4 * rng.poisson(1e4 * light))


def _curve(folder: Path) -> None:
    """An MTF that was measured elsewhere."""
    rows = [f"{frequency},{np.exp(-((frequency / 90) ** 2)):.6f}" for frequency in range(0, 201, 10)]
    (folder / "curve.csv").write_text("\n".join(["cycles/mm,mtf", *rows]) + "\n", encoding="utf-8")


def _write(path: Path, counts: NDArray[np.float64]) -> None:
    tifffile.imwrite(path, np.rint(counts).astype(np.uint16), photometric="minisblack", metadata=None)


_DRAWN: dict[str, Callable[[Path], None]] = {
    "curve": _curve,
    "edge": _edge,
    "exposures": _exposures,
    "large_photographs": _large_photographs,
    "photographs": _photographs,
}
