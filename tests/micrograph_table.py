"""A table of drawn microscope pictures: how far what is read of them lies from the truth, and how often within its bar.

Run it by hand: python tests/micrograph_table.py [COUNT]
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from micrograph_simulator import Microscope, of_mask, rounded
from scipy import ndimage

from maskfab.base.errors import OpeningError
from maskfab.display.micrograph import SeenCell, seen_cell
from maskfab.display.pictures import read_picture
from maskfab.mask.opening_file import load_opening
from maskfab.optics.colour import light_of_code

SHIPPED = (
    "toled", "poled", "stripe", "bar", "fits", "fits_300", "fits_88", "fits_packed", "paper_inv_periodic",
    "paper_l2_periodic", "diamond", "delta", "rgb_stripe", "circular", "density_quiet", "pentile_diamond", "rounded",
)  # fmt: skip


def truth(name: str):
    """Cell, pitch in um, and the dots along it."""
    if name == "rounded":
        return rounded(), 78.0, 2000
    opening = load_opening(Path("layouts/openings") / f"{name}.toml")
    if name == "pentile_diamond":  # its cell holds two pixels along each side
        return of_mask(opening.mask[:21, :21]), 63.0, 21
    return of_mask(opening.mask), opening.cell_size.pitch_nm / 1e3, opening.dots


def apart(found: SeenCell, cell, dots: int, px: float) -> tuple[float, float, float]:
    """Difference of open ratio, relative, and rms and mean distance of edges, in pixels of the picture."""
    size = -(-1800 // dots) * dots
    places = (np.arange(size) + 0.5) / size * len(found.clear) - 0.5
    outline = ndimage.map_coordinates(
        found.clear, np.meshgrid(places, places, indexing="ij"), order=1, mode="grid-wrap"
    )
    outline = outline > 0.5
    at = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(at, at)
    wanted = cell(x, y)
    # where the cell begins is free: the shift that covers most, then refined around it
    power = np.fft.rfft2(wanted.astype(float)) * np.conj(np.fft.rfft2(outline.astype(float)))
    likeness = np.fft.irfft2(power, s=(size, size))
    dy, dx = np.unravel_index(np.argmax(likeness), likeness.shape)
    moved = np.roll(outline, (dy, dx), (0, 1))
    tiled = np.pad(wanted, 40, mode="wrap")
    far = np.where(tiled, ndimage.distance_transform_edt(tiled) - 0.5, -(ndimage.distance_transform_edt(~tiled) - 0.5))
    far = far[40:-40, 40:-40]
    edge = moved & ~ndimage.binary_erosion(moved, border_value=1)
    distance = (far[edge] - 0.5) * px / size
    ratio = found.clear.mean() / wanted.mean() - 1
    return float(ratio), float(np.sqrt(np.mean(distance**2))), float(distance.mean())


def main(count: int) -> None:
    rng = np.random.default_rng(5)
    within, within_area, within_scale, good, done = 0, 0, 0, 0, 0
    for number in range(count):
        name = SHIPPED[number % len(SHIPPED)]
        cell, pitch, dots = truth(name)
        scale = float(np.exp(rng.uniform(np.log(2), np.log(min(20, 500 / pitch)))))
        side = scale * pitch
        wide = float(np.clip(rng.uniform(2.3, 6), 2.3, max(2.3, 1300 / side)))
        shape = int(side * max(2.2, wide * 0.8)), int(side * wide)
        scope = Microscope(
            scale, rng.uniform(-3, 3), rng.uniform(-0.03, 0.03), rng.uniform(0.5, 1.5), rng.uniform(-0.3, 0.3),
            rng.uniform(0.005, 0.04), int(rng.integers(0, 6)), bool(rng.integers(2)), int(rng.choice([0, 90])),
        )  # fmt: skip
        started = time.time()
        with tempfile.TemporaryDirectory() as folder:
            path = scope.photograph(Path(folder) / "photo", cell, pitch, shape, rng)
            light = light_of_code(read_picture(path).values[:, :, :3].astype(float)).mean(2)
        drawn, started = time.time() - started, time.time()
        told = f"{number:3d} {name:18s} {scale:5.1f} px/um {shape[1]:5d} x {shape[0]:4d}"
        told += f" turn {scope.turn_deg:+.1f} blur {scope.blur_px:.1f} noise {scope.noise:.3f} "
        try:
            found = seen_cell(light, pitch, "bright" if scope.transmitted else "dark", 1, path.name)
        except OpeningError as error:
            print(told, error.code, error.what, flush=True)
            continue
        ratio, rms, mean = apart(found, cell, dots, side)
        bar = found.open_ratio_bar / found.open_ratio
        within += abs(mean) <= found.edge_bar_px
        within_area += abs(ratio) <= bar
        within_scale += abs(found.px_per_um / scale - 1) < found.px_per_um_bar / scale
        good += abs(ratio) < 0.01 and rms < 0.3
        done += 1
        told += f" pixels {found.pixels} area {ratio:+.2%} +- {bar:.2%} edge rms {rms:.2f} mean {mean:+.3f}"
        told += f" +- {found.edge_bar_px:.3f} px, sigma {found.blur_px:.2f}, scale {found.px_per_um / scale - 1:+.4%}"
        told += f" +- {found.px_per_um_bar / scale:.4%}, turn {found.turn_deg - scope.turn_deg:+.2f}, {found.cells:.1f}"
        print(told, f"cells {drawn:.0f} + {time.time() - started:.1f} s", flush=True)
    print(f"{done} of {count} read; {good} within 1 % and .3 px; within their bars:")
    print(f"edge {within}, area {within_area}, scale {within_scale}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 40)
