"""The table of numbers that README quotes, measured here and now: ``make bench``.

Errors are relative L2 unless stated. Times are wall-clock on whatever else the machine is doing.
"""

from __future__ import annotations

import filecmp
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from optics_cases import camera, noise, panel, pupil
from scipy.special import j1

from maskfab.base.resources import path
from maskfab.job.camera import Stop
from maskfab.mask.formats.gdsii import write_gdsii, write_oasis
from maskfab.mask.job import load_job
from maskfab.mask.layout import plate_layout
from maskfab.optics.field.matrix import parity_field
from maskfab.optics.psf import image_scale_um2, point_psf
from maskfab.runs.pipeline import run


def dots_against_direct_sum() -> float:
    """Random dots of 8 um in a 4 mm square stop: 40 000 of them, one by one."""
    laid_out = panel(noise(21, 0.2, 1), cells=24, seed=2)
    source = pupil(laid_out, Stop("square", laid_out.pitch_nm * 24 / 1e3))
    u = np.linspace(0.0, 0.025, 24)
    x, y = source.x.edges_um(), source.y.edges_um()
    rows, columns = np.nonzero(source.whole)
    centre_x, centre_y = (x[columns] + x[columns + 1]) / 2, (y[rows] + y[rows + 1]) / 2
    dot = 8.0 * np.sinc(8.0 * u)
    expected = np.empty((u.size, u.size), dtype=np.complex128)
    for j, v in enumerate(u):
        phases = np.exp(-2j * np.pi * (u[:, None] * centre_x + v * centre_y))
        expected[j] = dot[j] * dot * phases.sum(axis=1)
    found = parity_field(source, u, u).amplitude()[u.size - 1 :, u.size - 1 :]
    return float(np.linalg.norm(found - expected) / np.linalg.norm(expected))


def airy_error(diameter_um: float) -> float:
    """PSF of an open circular stop against the Airy pattern."""
    setting = camera(diameter_um, window_um=256.0)
    cells = 2 * int(np.ceil(diameter_um / 80))
    found = point_psf(pupil(panel(np.ones((5, 5), dtype=np.bool_), cells=cells), setting.stop), setting, 530.0)
    scale = image_scale_um2(setting, 530.0)
    axis = found.step_um * (np.arange(found.values.shape[0]) - found.values.shape[0] // 2) / scale
    argument = np.pi * diameter_um * np.hypot(axis[:, None], axis)
    argument[argument == 0] = 1e-30
    expected = (setting.stop.area_um2 * 2 * j1(argument) / argument) ** 2 / (scale**2 * setting.stop.area_um2)
    return float(np.linalg.norm(found.values - expected) / np.linalg.norm(expected))


def main() -> None:
    """Measure and print everything; exit 1 if a target is missed."""
    rows = [
        ("field of 40 000 square dots against a direct sum", dots_against_direct_sum(), 1e-12, "relative L2"),
        ("PSF of the open stop against Airy, D = 4 mm", airy_error(4000.0), 1e-4, "relative L2"),
        ("PSF of the open stop against Airy, D = 0.1 mm", airy_error(100.0), 1e-4, "relative L2"),
    ]
    job = load_job(path("layouts/upc12.toml"))
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder) / "first", Path(folder) / "second"
        start = time.perf_counter()
        run(job, first)
        seconds = time.perf_counter() - start
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
        run(job, second)
        document = json.loads((first / "report.json").read_text())
        optics_seconds = json.loads((first / "timing.json").read_text())["seconds"]["optics"]
        masks = ("UPC12.gds", "UPC12.oas", "UPC12_R12.dxf", "UPC12_R2010.dxf", "report.html", "report.json")
        different = sum(not filecmp.cmp(first / name, second / name, shallow=False) for name in masks)
        start = time.perf_counter()
        layout = plate_layout(job.plate())
        built = time.perf_counter() - start
        start = time.perf_counter()
        write_gdsii(layout, second / "UPC12.gds")
        write_oasis(layout, second / "UPC12.oas")
        written = time.perf_counter() - start
        size = sum((second / name).stat().st_size for name in masks[:2]) / 1e6

    def worst(name: str) -> float:
        return max(abs(q["value"]) for q in document["checks"] if q["name"] == name)

    rows += [
        ("polygon path against matrix path, worst die and line", worst("readback_psf_difference"), 1e-6, "relative L2"),
        ("peak Strehl against η², worst die and line", worst("strehl_invariant_error"), 1e-3, "relative"),
        ("MTF volume against η, worst die", worst("mtf_volume_invariant_error"), 1e-3, "relative"),
        ("XOR of all files read back against the design", worst("readback_xor_area"), 0, "um^2"),
        ("run of layouts/upc12.toml", seconds, 90, "s"),
        ("its optics: twelve dies, three colours, PSF and MTF, both paths", optics_seconds, 10, "s"),
        ("its peak memory", memory, 1.5, "GB"),
        ("GDSII + OASIS of twelve dies", size, 10, "MB"),
        ("building their layout", built, 3, "s"),
        ("writing both", written, 3, "s"),
        ("files that differ between two runs", different, 0, "files"),
    ]
    width = max(len(row[0]) for row in rows)
    print(f"{'what':{width}}  {'measured':>10}  {'target':>10}  unit")
    for what, value, target, unit in rows:
        missed = "" if value <= target else "  MISSED"
        print(f"{what:{width}}  {value:10.3g}  {'<= ' + format(target, 'g'):>10}  {unit}{missed}")
    sys.exit(any(value > target for _, value, target, _ in rows))


if __name__ == "__main__":
    main()
