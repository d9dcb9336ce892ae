"""A made-up report of two dies, one of which fails: no optics, only the shapes that the report is fed with."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest

from maskfab.base.model import (
    CLEAR,
    OUTLINE,
    Die,
    DieOptics,
    Mark,
    Mtf,
    Opening,
    Panel,
    Plate,
    Psf,
    Quantity,
    RadialMean,
    Report,
    Tiling,
    WrittenFile,
)
from maskfab.findings.scene import SceneOptics, measure_scene, scene_plan
from maskfab.job.camera import Camera, Stop
from maskfab.optics.pupil import panel_aperture
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import Band, Curve

MARKUP = "<script>alert('x')</script>"


@dataclass(frozen=True)
class Run:
    report: Report
    plate: Plate
    camera: Camera
    optics: tuple[DieOptics, ...]


@pytest.fixture(scope="session")
def run() -> Run:
    camera = Camera(10_000.0, Stop("circle", 4000.0), (610.0, 530.0), 2.0, 64.0)
    optics = (_die("PLAIN", "Plain", Tiling.PERIODIC, camera), _die("TURNED", MARKUP, Tiling.RANDOM, camera))
    square = ((0, 0), (1_000_000, 0), (1_000_000, 1_000_000), (0, 1_000_000))
    marks = (
        Mark("FID_0", "fiducial", CLEAR, (square,)),
        Mark("BLANK", "outline", OUTLINE, (square,)),
    )
    dies = tuple(item.die for item in optics)
    plate = Plate("P", f"Plate {MARKUP} $", 127_000_000, 117_000_000, dies, marks, (), ())
    gauge = Quantity("cd_1_x", 8.0, "probe on the file", 0.0005, 8.0, True)
    own = [quantity for item in optics for quantity in item.quantities]
    report = Report(
        title=plate.title,
        job_hash="ab" * 32,
        seeds={"TURNED": 7},
        dies={item.die.name: item.quantities for item in optics},
        plate=(gauge, Quantity("polygons", 12_345, "count")),
        checks=(*(quantity for quantity in own if quantity.passed is not None), gauge),
        files=(WrittenFile("P.gds", "GDSII", 1234, "c" * 64), WrittenFile("P.dxf", "DXF R12", 99, "d" * 64)),
        seconds={"export": 0.25},
    )
    return Run(report, plate, camera, optics)


@pytest.fixture(scope="session")
def seen(run) -> tuple[SceneOptics, ...]:
    """The second die in a scene with a field behind a gap, depth, and two bands of light."""
    die, shape = run.plate.dies[1], np.array([400.0, 500.0])
    bands = tuple(Band((Curve(shape + 100 * k, np.ones(2), name),), name) for k, name in enumerate(("blue", "<red>")))
    camera = Camera(10_000.0, Stop("circle", 200.0), (530.0,), 2.0, 64.0)
    scene = Scene(3e4, math.inf, math.inf, 8000.0, 30.0, ((4, 0.01),), True, bands)
    plan = scene_plan(die, camera, scene, 0.5, "job.toml")
    return (measure_scene(die, camera, scene, panel_aperture(die.panel), plan),)


def _die(name: str, label: str, tiling: Tiling, camera: Camera) -> DieOptics:
    mask = np.zeros((5, 5), dtype=bool)
    mask[1:4, 1:3] = True
    turned = tiling is Tiling.RANDOM
    orientations = (np.arange(64).reshape(8, 8) % 8 if turned else np.zeros((8, 8))).astype(np.int8)
    panel = Panel(Opening("block", mask, 8000), 8000, 2000, orientations, tiling, 7 if turned else None)
    die = Die(name, label, panel, (10_000_000 if turned else -10_000_000, 0), 12_000_000)
    names = ("open_ratio", "stop_open_ratio")
    psfs, mtfs, rows = [], [], [Quantity(each, panel.open_ratio, "exact", 0.0, die=name) for each in names]
    for line in camera.wavelengths_nm:
        axis = np.arange(-16, 17) / (line / 100)
        values = np.sinc(axis)[:, None] ** 2 * np.sinc(axis) ** 2
        psfs.append(Psf(values, 2.0, line, "point"))
        frequency = np.linspace(0.0, 250.0, 300)
        cut = np.exp(-frequency / line)
        names = ("horizontal", "vertical", "diagonal", "antidiagonal", "radial_mean")
        cuts = {**dict.fromkeys(names, cut), "radial_min": cut**2, "radial_max": np.sqrt(cut)}
        falls = RadialMean(frequency, cut, np.full(frequency.size, 1e-7))
        mtfs.append(Mtf(frequency, cuts, line, 1e-7, 1e-8, falls))
        difference = 3e-4 if turned else 2.5e-13
        rows += [
            Quantity("auc_radial_min", 0.123456789, "mean", 1e-7, die=name, wavelength_nm=line),
            Quantity(
                "readback_psf_difference",
                np.float64(difference),
                "relative L2",
                limit=1e-6,
                passed=not turned,
                die=name,
                wavelength_nm=line,
            ),
        ]
    rows.append(Quantity("shop_flashes", None, "guess", die=name, detail="furlong"))
    return DieOptics(die, tuple(psfs), tuple(mtfs), tuple(rows))
