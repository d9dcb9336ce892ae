"""Panels, cameras and scenes that the planner and what carries out its plans are held to, and their plans."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from optics_cases import camera, noise, panel

from maskfab.base.model import Panel
from maskfab.job.camera import Camera
from maskfab.optics.response import camera_bands, generic_rgb
from maskfab.optics.scene.plan import CostModel, Plan, cost_model, plan
from maskfab.optics.scene.scene import Scene

RGB = tuple(camera_bands(generic_rgb()).values())

SLIT = np.zeros((7, 7), dtype=np.bool_)
SLIT[1:6, 3:5] = True
RING = np.zeros((9, 9), dtype=np.bool_)
RING[2:7, 2:7] = True
RING[3:6, 3:6] = False


@dataclass(frozen=True, eq=False)
class Case:
    """A panel, a camera, a scene, and an accuracy."""

    name: str
    panel: Panel
    camera: Camera
    scene: Scene
    accuracy: float


def case(
    name: str,
    mask: np.ndarray,
    scene: Scene,
    accuracy: float,
    *,
    diameter_um: float = 300.0,
    shape: str = "circle",
    lines: tuple[float, ...] = (530.0,),
    gutter_nm: int = 0,
    seed: int | None = 1,
    dot_nm: int = 8000,
) -> Case:
    pitch = mask.shape[0] * dot_nm / 1e3 + gutter_nm / 1e3
    cells = 2 * math.ceil((diameter_um / 2 + 120) / pitch)
    laid_out = panel(mask, cells=cells, seed=seed, gutter_nm=gutter_nm, dot_nm=dot_nm)
    return Case(name, laid_out, camera(diameter_um, shape, lines, 96.0), scene, accuracy)


DENSE, SPARSE = noise(7, 0.6, 4), noise(9, 0.25, 5)
CASES = (
    case("plain random", DENSE, Scene(), 1e-2),
    case("plain periodic", DENSE, Scene(), 1e-2, seed=None),
    case("plain slit", SLIT, Scene(), 1e-3, seed=None, diameter_um=200.0),
    case("fine dots", SPARSE, Scene(), 1e-3, dot_nm=4000, diameter_um=240.0),
    case("gutter", SLIT, Scene(), 1e-2, gutter_nm=6000),
    case("square", SPARSE, Scene(), 1e-2, shape="square", diameter_um=283.0),
    case("square on dots", DENSE, Scene(), 1e-6, shape="square", diameter_um=304.0),
    case("certify", DENSE, Scene(), 1e-6),
    case("tighter than single", DENSE, Scene(), 1e-7),
    case("far objects", DENSE, Scene(nearest_um=2e7), 1e-2),
    case("far objects, slit", SLIT, Scene(nearest_um=1e7, farthest_um=1e8), 1e-2, seed=None),
    case("near objects", DENSE, Scene(nearest_um=3e5), 1e-2),
    case("focus near", DENSE, Scene(nearest_um=1e6, farthest_um=2e6, focus_um=1.5e6), 3e-2),
    case("focus far", SPARSE, Scene(nearest_um=5e6, focus_um=1e7), 3e-2, diameter_um=400.0),
    case("focus far, ring", RING, Scene(focus_um=2e7), 1e-2, gutter_nm=4000),
    case("weak spherical", DENSE, Scene(aberrations=((11, 0.002),)), 5e-2),
    case("weak coma", SLIT, Scene(aberrations=((7, 0.002), (8, -0.001))), 5e-2, seed=None),
    case("weak astigmatism, square", SPARSE, Scene(aberrations=((6, 0.002),)), 0.1, shape="square"),
    case("tilt", RING, Scene(aberrations=((2, 0.003),)), 5e-2, lines=(470.0, 610.0)),
    case("strong mixture", DENSE, Scene(aberrations=((4, 0.05), (11, 0.03))), 1e-2),
    case("aberrated and deep", SPARSE, Scene(nearest_um=1e7, aberrations=((6, 0.05),)), 3e-2),
    case("thin gap", DENSE, Scene(gap_um=2.0), 5e-2),
    case("thin gap, periodic", DENSE, Scene(gap_um=2.0), 0.2, seed=None),
    case("gap, slit", SLIT, Scene(gap_um=20.0), 0.5, diameter_um=400.0),
    case("gap, ring", RING, Scene(gap_um=20.0), 0.5, diameter_um=400.0, gutter_nm=4000),
    case("gap and field", DENSE, Scene(gap_um=20.0, field_um=500.0), 0.5),
    case("gap and field, periodic", SLIT, Scene(gap_um=20.0, field_um=1500.0), 0.6, seed=None),
    case("gap and field, square", SPARSE, Scene(gap_um=40.0, field_um=1000.0), 0.6, shape="square"),
    case("gap and field, tight", SPARSE, Scene(gap_um=20.0, field_um=1500.0), 0.006),
    case("field without gap", DENSE, Scene(field_um=2000.0), 1e-3),
    case("colours", SPARSE, Scene(bands=RGB), 2e-2),
    case("colours by three lines", RING, Scene(bands=RGB), 0.8, diameter_um=200.0),
    case("colours, slit", SLIT, Scene(bands=RGB), 3e-2, seed=None, diameter_um=200.0),
    case("three lines", SPARSE, Scene(nearest_um=1e7), 3e-2, lines=(610.0, 530.0, 470.0)),
)
PLANS: dict[str, Plan] = {}
PRICES: dict[str, CostModel] = {}


def planned(each: Case) -> Plan:
    if each.name not in PLANS:
        PLANS[each.name] = plan(each.panel, each.camera, each.scene, each.accuracy)
    return PLANS[each.name]


def priced(each: Case) -> CostModel:
    if each.name not in PRICES:
        PRICES[each.name] = cost_model(each.panel, each.camera, each.scene, each.accuracy)
    return PRICES[each.name]
