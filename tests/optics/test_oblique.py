"""PSFs off the axis and behind tilted panels, against sums with the exact phase that share no optics with the package.

Rays, directions and areas are written here once more, from vectors: a point of the panel is P = X e_x + Y e_y, light of
direction d leaves it with the phase 2π (d - d0)·P / λ, and it counts if the ray through P along d0 meets the stop.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from optics.scene_cases import DENSE, SPARSE, case

from maskfab.base.errors import JobError
from maskfab.base.model import Panel, Psf
from maskfab.job.process import UNSTATED, Glass, MaskBlank
from maskfab.optics.pupil import panel_aperture
from maskfab.optics.scene.lens import RESAMPLED, Lens, Projection, SensorWindow
from maskfab.optics.scene.plan import Plan, plan
from maskfab.optics.scene.point_images import scene_psf
from maskfab.optics.scene.scene import Scene

FOCAL = 10_000.0
NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)


def direction(kind: str, place: np.ndarray) -> np.ndarray:
    """Unit vectors of the light that lands at places [n, 2] on the sensor."""
    radius = np.hypot(*place.T)
    angle = np.arctan(radius / FOCAL) if kind == "f tan" else radius / FOCAL
    unit = np.where(radius[:, None] > 0, place / np.maximum(radius, 1e-300)[:, None], 0.0)
    return np.column_stack([np.sin(angle)[:, None] * unit, np.cos(angle)])


def spread(kind: str, place: np.ndarray) -> np.ndarray:
    """Area of (l, m) over that of the sensor: cos⁴ θ / f², or sin θ cos θ / θ / f²."""
    theta = np.arccos(direction(kind, place)[:, 2])
    if kind == "f tan":
        return np.cos(theta) ** 4 / FOCAL**2
    return np.sinc(theta / np.pi) * np.cos(theta) / FOCAL**2


def runs(panel: Panel) -> list[tuple[float, float, list[tuple[float, float]]]]:
    """Every row of dots: its lower and upper edge, and the ends of its clear dots, from the panel's own arrays."""
    dot, pitch = panel.dot_nm / 1e3, panel.cell_size.pitch_um
    rows, columns = panel.orientations.shape
    found = []
    for j in range(rows):
        for k in range(panel.opening.dots):
            bottom = (j - rows / 2) * pitch + panel.gutter_nm / 2e3 + k * dot
            ends = [
                (left, left + dot)
                for i in range(columns)
                for n in np.flatnonzero(panel.patterns[panel.orientations[j, i]][k])
                for left in [(i - columns / 2) * pitch + panel.gutter_nm / 2e3 + n * dot]
            ]
            found.append((bottom, bottom + dot, ends))
    return found


def brute(
    panel: Panel, stop: str, width: float, d0: np.ndarray, d: np.ndarray, line_nm: float, tilt: float, gap: float
) -> np.ndarray:
    """|F|² / (λ² E) at directions d [n, 3] of light that came from d0."""
    axis_x = np.array([math.cos(tilt), 0.0, -math.sin(tilt)])
    cycles = (d - d0) @ np.column_stack([axis_x, [0.0, 1.0, 0.0]]) / (line_nm * 1e-3)
    s, t = d0[0] / d0[2], d0[1] / d0[2]
    # x = a X + x0 and y = Y + b X + y0 in the stop's plane.
    a, b, x0, y0 = math.cos(tilt) + s * math.sin(tilt), t * math.sin(tilt), s * gap, t * gap
    half = width / 2

    def ends(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """From where to where a line at Y lies in front of the stop."""
        if stop == "square":
            low, high = np.full(y.size, -half), np.full(y.size, half)
            left, right = (low - x0) / a, (high - x0) / a
            if b:
                sides = np.sort([(sign * half - y0 - y) / b for sign in (-1, 1)], axis=0)
                left, right = np.maximum(left, sides[0]), np.minimum(right, sides[1])
            else:
                right = np.where(abs(y + y0) <= half, right, left)
            return left, np.maximum(left, right)
        # (a X + x0)² + (Y + b X + y0)² = R²
        p, q, r = a * a + b * b, a * x0 + b * (y + y0), x0 * x0 + (y + y0) ** 2 - half**2
        root = np.sqrt(np.maximum(q * q - p * r, 0.0))
        return (-q - root) / p, (-q + root) / p

    def crossings(x: float) -> list[float]:
        """Y at which the footprint's edge crosses a line of that X."""
        if stop == "square":
            return [sign * half - y0 - b * x for sign in (-1, 1)]
        chord = half**2 - (a * x + x0) ** 2
        return [] if chord < 0 else [sign * math.sqrt(chord) - b * x - y0 for sign in (-1, 1)]

    corners = [(sign * half - x0) / a for sign in (-1, 1)]
    total, energy = np.zeros(len(d), dtype=np.complex128), 0.0
    top = half * math.hypot(1.0, b / a)
    middle = -y0 + b * x0 / a
    for bottom, upper, clear in runs(panel):
        if not clear:
            continue
        kinks = [bottom, upper] + [y for x in [*corners, *(x for pair in clear for x in pair)] for y in crossings(x)]
        kinks += [middle - top, middle + top]
        breaks = np.unique([y for y in kinks if bottom <= y <= upper])
        # y = middle + top sin(phi) takes the root at the footprint's poles away.
        phi = np.arcsin(np.clip((breaks - middle) / top, -1, 1)) if stop == "circle" else breaks
        span = np.diff(phi)
        node = (phi[:-1, None] + span[:, None] * (NODES + 1) / 2).ravel()
        weight = (span[:, None] * WEIGHTS / 2).ravel()
        y = middle + top * np.sin(node) if stop == "circle" else node
        weight = weight * top * np.cos(node) if stop == "circle" else weight
        left, right = ends(y)
        for x1, x2 in clear:
            low, high = np.clip(x1, left, right), np.clip(x2, left, right)
            lit = high > low
            if not lit.any():
                continue
            width_x, centre = (high - low)[lit], (high + low)[lit] / 2
            along = (
                width_x
                * np.sinc(np.outer(cycles[:, 0], width_x))
                * np.exp(-2j * np.pi * np.outer(cycles[:, 0], centre))
            )
            total += (along * np.exp(-2j * np.pi * np.outer(cycles[:, 1], y[lit]))) @ weight[lit]
            energy += float(weight[lit] @ width_x)
    return abs(total) ** 2 / ((line_nm * 1e-3) ** 2 * energy)


def errs(
    scene: Scene, place: tuple[float, float], line_nm: float, *, stop: str = "circle", mask: np.ndarray = DENSE,
    gutter_nm: int = 0, blank: MaskBlank = UNSTATED, accuracy: float = 1e-8, shadow: bool = False,
) -> tuple[float, Plan]:  # fmt: skip
    """Relative L2 difference of a planned PSF and the sum, over the window's middle and places all over it."""
    kind, seen_scene = "f tan" if scene.projection is None else "f theta", scene.through(blank)
    each = case("oblique", mask, seen_scene, accuracy, lines=(530.0, 470.0), shape=stop, gutter_nm=gutter_nm)
    found = plan(each.panel, each.camera, seen_scene, accuracy)
    if shadow:
        # Gap and tilt as what rays meet, without diffraction between panel and stop.
        choice = replace(
            found.choice, path="direct", precision="double", grey_rim=False, oblique=True, places=33,
            diffraction=False, samples_per_dot=0,
        )  # fmt: skip
        found = replace(found, choice=choice)
    seen = scene_psf(panel_aperture(each.panel), each.camera, seen_scene, found, line_nm, image_um=place)
    half = seen.values.shape[0] // 2
    rows, columns = (index.ravel() for index in np.mgrid[half - 3 : half + 4, half - 3 : half + 4])
    scattered = np.random.default_rng(1).integers(0, 2 * half + 1, (2, 12))
    rows, columns = np.append(rows, scattered[0]), np.append(columns, scattered[1])
    offset = seen.step_um * (np.arange(2 * half + 1) - half)
    places = np.column_stack([place[0] + offset[columns], place[1] + offset[rows]])
    d0, d = direction(kind, np.array([place]))[0], direction(kind, places)
    ahead = d @ np.array([math.sin(scene.tilt_rad), 0.0, math.cos(scene.tilt_rad)]) / d[:, 2]
    gap = scene.gap_um
    if blank.glass is not None:
        sine = math.hypot(d0[0], d0[1]) / blank.glass.index
        gap += blank.glass.thickness_um * sine / math.sqrt(1 - sine**2) / (math.hypot(d0[0], d0[1]) / d0[2])
    exact = brute(each.panel, stop, each.camera.stop.diameter_um, d0, d, line_nm, scene.tilt_rad, gap)
    exact = exact * spread(kind, places) * ahead
    return float(np.linalg.norm(seen.values[rows, columns] - exact) / np.linalg.norm(exact)), found


def worst(scene: Scene, place: tuple[float, float], line_nm: float, **options: Any) -> float:
    error, found = errs(scene, place, line_nm, **options)
    assert found.choice.oblique
    return error


def height(kind: str, degrees: float) -> float:
    angle = math.radians(degrees)
    return FOCAL * (math.tan(angle) if kind == "f tan" else angle)


@pytest.mark.parametrize("kind", ["f tan", "f theta"])
@pytest.mark.parametrize("degrees", [0.0, 20.0, 40.0, 60.0])
def test_a_psf_off_the_axis_is_the_sum_with_the_exact_phase(kind: str, degrees: float) -> None:
    reach = height(kind, 60.0)
    scene = Scene(field_um=reach, projection=None if kind == "f tan" else Projection.even(FOCAL))
    radius = height(kind, degrees)
    place = (0.8 * radius, 0.6 * radius)
    assert worst(scene, place, 530.0 if degrees in (0.0, 40.0) else 470.0) < 1e-9


@pytest.mark.parametrize("stop", ["circle", "square"])
def test_gutters_and_two_lines(stop: str) -> None:
    reach = height("f tan", 40.0)
    scene = Scene(field_um=reach)
    for line in (530.0, 470.0):
        assert worst(scene, (0.6 * reach, -0.8 * reach), line, stop=stop, mask=SPARSE, gutter_nm=6500) < 1e-9


@pytest.mark.parametrize(
    ("stop", "place", "tilt"),
    [("circle", (1.0, 0.0), 3.0), ("circle", (-1.0, 0.0), 3.0), ("circle", (0.0, 0.0), -5.0),
     ("square", (0.6, 0.8), 3.0), ("square", (-0.8, 0.6), -2.0)],
)  # fmt: skip
@pytest.mark.parametrize("kind", ["f tan", "f theta"])
def test_a_tilted_panel_is_seen_in_its_own_plane(kind: str, stop: str, place: tuple[float, float], tilt: float) -> None:
    reach = height(kind, 40.0)
    scene = Scene(
        field_um=reach, tilt_rad=math.radians(tilt), projection=None if kind == "f tan" else Projection.even(FOCAL)
    )
    assert worst(scene, (reach * place[0], reach * place[1]), 530.0, stop=stop, shadow=True, accuracy=0.9) < 1e-9


def test_a_round_footprint_that_is_sheared_is_a_polygon_near_enough() -> None:
    reach = height("f tan", 40.0)
    scene = Scene(field_um=reach, tilt_rad=math.radians(3.0))
    assert worst(scene, (0.6 * reach, 0.8 * reach), 530.0, shadow=True, accuracy=0.9) < 1e-7


@pytest.mark.parametrize("kind", ["f tan", "f theta"])
def test_over_a_gap_light_walks_by_the_tangent_and_through_glass_by_snells(kind: str) -> None:
    reach = height(kind, 40.0)
    projection = None if kind == "f tan" else Projection.even(FOCAL)
    scene = Scene(field_um=reach, gap_um=40.0, projection=projection)
    place = (0.6 * reach, -0.8 * reach)
    assert worst(scene, place, 530.0, shadow=True, accuracy=0.9) < 1e-9
    glass = MaskBlank(glass=Glass(60.0, 1.5, "away"))
    assert worst(scene, place, 530.0, shadow=True, accuracy=0.9, blank=glass) < 1e-9
    tilted = replace(scene, tilt_rad=math.radians(2.0))
    assert worst(tilted, (reach, 0.0), 530.0, shadow=True, accuracy=0.9) < 1e-9
    assert worst(tilted, place, 530.0, stop="square", shadow=True, accuracy=0.9, blank=glass) < 1e-9


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 1e-6])
def test_a_plan_that_meets_an_accuracy_at_twenty_degrees_is_within_it_of_the_truth(accuracy: float) -> None:
    """What foreshortening and projection change, 0.07 and 0.17, was once beside a plan's error, not in it."""
    reach = height("f tan", 20.0)
    for place in ((reach, 0.0), (-0.6 * reach, 0.8 * reach)):
        error, found = errs(Scene(field_um=reach), place, 470.0, accuracy=accuracy)
        assert error <= found.price.error <= accuracy


def test_a_small_field_leaves_oblique_light_out_and_errs_no_more_than_it_says() -> None:
    reach = height("f tan", 1.0)
    error, found = errs(Scene(field_um=reach), (reach, 0.0), 470.0, accuracy=5e-2)
    assert not found.choice.oblique
    assert 0.1 * found.price.error < error <= found.price.error


def test_diffraction_behind_a_tilted_panel_is_counted_and_refused_where_it_matters() -> None:
    scene = Scene(field_um=1000.0, tilt_rad=math.radians(3.0))
    each = case("tilted", DENSE, scene, 0.1, diameter_um=600.0)
    found = plan(each.panel, each.camera, scene, each.accuracy)
    (row,) = (row for row in found.ingredients if row.name == "diffraction over the gap")
    assert found.choice.oblique
    assert not row.modelled
    assert 1e-3 < row.error <= found.price.error <= each.accuracy
    with pytest.raises(JobError, match=r"MF115 .*scene\.accuracy"):
        plan(each.panel, each.camera, scene, row.error / 2)


@pytest.mark.parametrize(("degrees", "dot_nm", "text"), [(75.1, 8000, "75"), (60.0, 1000, "walls of a film")])
def test_a_field_beyond_what_is_proved_is_refused(degrees: float, dot_nm: int, text: str) -> None:
    each = case("steep", DENSE, Scene(field_um=height("f tan", degrees)), 1e-3, dot_nm=dot_nm, diameter_um=100.0)
    with pytest.raises(JobError, match=rf"MF104 .*{text}.*scene\.field"):
        plan(each.panel, each.camera, each.scene, each.accuracy)


def test_a_table_is_the_curve_through_its_rows() -> None:
    angles = np.radians(np.arange(5.0, 81.0, 5.0))
    lens = Lens(FOCAL, FOCAL, Projection(FOCAL, tuple(angles), tuple(2 * FOCAL * np.sin(angles / 2))))
    x, y = np.array([0.0, 100.0, 3000.0, -5000.0]), np.array([0.0, -200.0, 4000.0, 1000.0])
    theta = 2 * np.arcsin(np.hypot(x, y) / FOCAL / 2)
    sx, sy, area = lens.slopes(x, y)
    assert np.hypot(sx, sy) == pytest.approx(np.tan(theta), rel=1e-5)
    # Equal areas have equal solid angles.
    assert area * np.cos(theta) ** 3 * FOCAL**2 == pytest.approx(1.0, rel=1e-4)
    assert lens.illumination((3000.0, 4000.0)) == pytest.approx(math.cos(theta[2]), rel=1e-4)
    h = 1e-3
    ends = [[np.array(lens.slopes(x + k * a, y + k * b)[:2]) for k in (h, -h)] for a, b in ((1, 0), (0, 1))]
    across, up = ((ahead - behind) / (2 * h) for ahead, behind in ends)
    assert across[0] * up[1] - across[1] * up[0] == pytest.approx(area, rel=1e-6)


@pytest.mark.parametrize(
    ("angles", "heights"),
    [((0.2, 0.1), (2000.0, 3000.0)), ((0.1, 0.2), (1000.0, 900.0)), ((0.1, 0.2), (1100.0, 2200.0)),
     ((0.1, 0.2, 0.21, 0.7), (1000.0, 2000.0, 5000.0, 5010.0))],
)  # fmt: skip
def test_a_table_that_is_no_lens_is_refused(angles: tuple[float, ...], heights: tuple[float, ...]) -> None:
    with pytest.raises(JobError, match=r"MF104 .*scene\.projection"):
        Projection(FOCAL, angles, heights)


def test_light_falls_off_by_the_fourth_power_of_the_cosine_under_a_tangent() -> None:
    lens = Lens(FOCAL, FOCAL)
    assert lens.illumination((height("f tan", 40.0), 0.0)) == pytest.approx(math.cos(math.radians(40.0)) ** 4)
    even = Lens(FOCAL, FOCAL, Projection.even(FOCAL))
    theta = math.radians(60.0)
    assert even.illumination((0.0, FOCAL * theta)) == pytest.approx(math.sin(theta) * math.cos(theta) / theta)


def test_a_series_gives_a_psf_between_its_samples() -> None:
    """|Σ a exp(-2πi q·r)|² of points within half a period, at the coarsest samples that a camera has."""
    rng = np.random.default_rng(3)
    x, y, a = (*rng.uniform(-0.5, 0.5, (2, 20)), rng.normal(size=20))
    step = 1 / 2.3

    def intensity(qx: np.ndarray, qy: np.ndarray) -> np.ndarray:
        return abs(np.exp(-2j * np.pi * (np.multiply.outer(qx, x) + np.multiply.outer(qy, y))) @ a) ** 2

    qx, qy = np.meshgrid(*2 * [step * np.arange(-12, 13)])
    qx, qy = 0.9 * qx + 2e-3 * qy**2, 0.83 * qy - 1e-3 * qx**2
    window = SensorWindow(qx, qy, np.full(qx.shape, 2.0))
    half = window.half(step)
    samples = intensity(*np.meshgrid(*2 * [step * np.arange(-half, half + 1)]))
    found = window.of(Psf(samples, step, 530.0, "point"), step)
    assert np.linalg.norm(2 * found.values - intensity(qx, qy)) < RESAMPLED * np.linalg.norm(intensity(qx, qy))
