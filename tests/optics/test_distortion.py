"""Lenses that distort: where light lands, and the PSFs off the axis that come of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics.scene_cases import DENSE, SPARSE, case
from optics_cases import noise, shifted_psf

from maskfab.base.errors import JobError
from maskfab.optics.metrics import relative_difference
from maskfab.optics.pupil import Pupil, cut, panel_aperture
from maskfab.optics.scene.lens import Distortion, Lens, SensorWindow
from maskfab.optics.scene.plan import plan
from maskfab.optics.scene.point_images import full_plan, scene_psf
from maskfab.optics.scene.scene import Scene

LINE = 530.0
PLACE = (1200.0, 1500.0)


def direct_field(pupil: Pupil, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The sum over whole dots, one exponential each, at any frequencies."""
    rows, columns = np.nonzero(pupil.whole)
    x, y = (0.5 * (edges[1:] + edges[:-1]) for edges in (pupil.x.edges_um(), pupil.y.edges_um()))
    dot = pupil.x.dot_um
    phases = np.exp(-2j * np.pi * (np.outer(u, x[columns]) + np.outer(v, y[rows])))
    return phases.sum(axis=1) * dot**2 * np.sinc(u * dot) * np.sinc(v * dot)


@given(
    ratio=st.floats(-0.3, 0.3), height_um=st.floats(10.0, 1e5), share=st.floats(0.0, 0.99), angle=st.floats(0.0, 6.3)
)
def test_what_a_lens_displaces_it_also_brings_back(ratio: float, height_um: float, share: float, angle: float) -> None:
    lens = Distortion(ratio, height_um)
    radius = share * min(lens.farthest_um, 3 * height_um)
    x, y = np.array(radius * np.cos(angle)), np.array(radius * np.sin(angle))
    again = lens.displaced(*lens.undistorted(x, y))
    np.testing.assert_allclose(again, (x, y), rtol=1e-9, atol=1e-9 * height_um)


def test_areas_grow_by_the_determinant_of_the_displacement() -> None:
    lens, h = Distortion(0.02, 1000.0), 1e-3
    ends = [[lens.displaced(600.0 + sign * dx, 800.0 + sign * dy) for sign in (1, -1)] for dx, dy in ((h, 0), (0, h))]
    jacobian = np.array([(np.array(after) - np.array(before)) / (2 * h) for after, before in ends])
    assert lens.displaced(600.0, 800.0) == pytest.approx((612.0, 816.0))
    assert lens.magnification(np.array(600.0), np.array(800.0)) == pytest.approx(np.linalg.det(jacobian), rel=1e-8)
    assert np.linalg.det(jacobian) == pytest.approx(1.02 * 1.06, rel=1e-8)


@pytest.mark.parametrize("ratio", [0.02, -0.05])
def test_a_distorted_psf_is_the_direct_sum_where_the_lens_puts_it(ratio: float) -> None:
    """Every sample against exponentials at the frequency whose light lands there: no grid, no spline, no window."""
    scene = Scene(field_um=2000.0, distortion=Distortion(ratio, 2000.0))
    each = case("square", SPARSE, scene, 1e-4, diameter_um=9 * 16.0 * 8, shape="square")
    openings = panel_aperture(each.panel)
    pupil = cut(openings, each.camera.stop)
    assert not pupil.rim_row.size
    found = plan(each.panel, each.camera, scene, each.accuracy)
    seen = scene_psf(openings, each.camera, scene, found, LINE, image_um=PLACE)
    half, scale = seen.values.shape[0] // 2, LINE * 1e-3 * each.camera.focal_um
    rows, columns = (index.ravel() for index in np.mgrid[half - 4 : half + 5, half - 4 : half + 5])
    offset = seen.step_um * (np.arange(2 * half + 1) - half)
    x, y = scene.distortion.undistorted(PLACE[0] + offset[columns], PLACE[1] + offset[rows])
    x0, y0 = scene.distortion.undistorted(np.array(PLACE[0]), np.array(PLACE[1]))
    away, away0 = (np.sqrt(1 + (a**2 + b**2) / each.camera.focal_um**2) for a, b in ((x, y), (x0, y0)))
    field = direct_field(pupil, (x / away - x0 / away0) / scale, (y / away - y0 / away0) / scale)
    share = scene.distortion.ratio * (x**2 + y**2) / scene.distortion.height_um**2
    exact = abs(field) ** 2 / (scale**2 * pupil.energy_um2 * (1 + share) * (1 + 3 * share) * away**4)
    assert np.linalg.norm(seen.values[rows, columns] - exact) <= found.price.error * np.linalg.norm(exact)
    plain = scene_psf(openings, each.camera, replace(scene, distortion=None), found, LINE, image_um=PLACE)
    assert relative_difference(plain, seen) > 100 * found.price.error


@pytest.mark.parametrize(
    ("diameter_um", "seed", "ratio", "field_um"),
    [(600.0, None, 0.02, 2000.0), (1708.0, 1, -0.05, 2000.0), (600.0, 2, 0.2, 2000.0), (600.0, 1, 1e-4, 20.0)],
)
def test_what_is_left_out_errs_no_more_than_stated(
    diameter_um: float, seed: int | None, ratio: float, field_um: float
) -> None:
    scene = Scene(field_um=field_um, distortion=Distortion(ratio, 2000.0))
    each = case("lens", DENSE, scene, 1e-3, diameter_um=diameter_um, seed=seed)
    found, openings = plan(each.panel, each.camera, scene, each.accuracy), panel_aperture(each.panel)
    (row,) = (row for row in found.ingredients if row.name == "oblique light")
    place = (0.6 * field_um, 0.75 * field_um)

    def seen(oblique: bool) -> object:
        choice = replace(found.choice, path="parity", precision="double", grey_rim=False, oblique=oblique)
        return scene_psf(openings, each.camera, scene, replace(found, choice=choice), LINE, image_um=place)

    error = relative_difference(seen(False), seen(True))
    assert error <= row.error <= 5 * error + 1e-3
    assert row.modelled == (row.error > each.accuracy)
    assert full_plan(found).choice.oblique


def test_behind_a_gap_light_comes_from_the_undistorted_angle() -> None:
    scene = Scene(field_um=1000.0, gap_um=300.0, distortion=Distortion(-0.1, 1000.0))
    each = case("gap", noise(7, 0.6, 4), scene, 0.1, diameter_um=400.0)
    found, openings = plan(each.panel, each.camera, scene, each.accuracy), panel_aperture(each.panel)
    choice = replace(
        found.choice, path="parity", precision="double", grey_rim=False, oblique=True, places=33,
        diffraction=False, samples_per_dot=0,
    )  # fmt: skip
    place = (900.0, 0.0)
    seen = scene_psf(openings, each.camera, scene, replace(found, choice=choice), LINE, image_um=place)
    middle = float(scene.distortion.undistorted(np.array(900.0), np.array(0.0))[0])
    assert middle > 980.0
    lens = Lens(each.camera.focal_um, each.camera.focal_um, scene.distortion)
    window = SensorWindow.about(lens, place, seen.step_um, seen.values.shape[0] // 2)
    wide = window.camera(each.camera, each.camera.stop)
    source = shifted_psf(openings, wide, LINE, scene.gap_um, (middle, 0.0))
    assert relative_difference(seen, window.of(source, seen.step_um)) < 1e-9


def test_a_scene_without_a_field_has_no_oblique_light() -> None:
    scene = Scene(distortion=Distortion(0.1, 1000.0))
    each = case("axis", DENSE, scene, 1e-3)
    found = plan(each.panel, each.camera, scene, each.accuracy)
    assert [row.error for row in found.ingredients if row.name == "oblique light"] == [0.0]
    assert not found.choice.oblique


def test_a_lens_that_folds_the_picture_is_refused() -> None:
    for ratio, height_um in ((0.5, 100.0), (float("nan"), 100.0), (0.1, 0.0), (0.1, float("inf"))):
        with pytest.raises(JobError, match="MF104"):
            Distortion(ratio, height_um)
    scene = Scene(field_um=1200.0, distortion=Distortion(-0.3, 1000.0))
    each = case("barrel", DENSE, scene, 1e-3)
    with pytest.raises(JobError, match=r"MF104 .* folds the picture \(scene\.distortion\)"):
        plan(each.panel, each.camera, scene, each.accuracy)
