"""Stops of every shape: against closed forms, the polygons' own path, and what the shape alone fixes."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from optics_cases import clear_region, noise, panel
from scipy.special import j1
from small_job import write_job
from sweeps import examples

from maskfab.base.errors import JobError
from maskfab.cli.program import run_command_line
from maskfab.designs.descent.objective import tiled_stop
from maskfab.job.camera import Camera, Stop
from maskfab.job.faults import parse_section
from maskfab.optics.field.matrix import parity_field
from maskfab.optics.field.polygons import boundary
from maskfab.optics.lags import lag_table
from maskfab.optics.phase import Wavefront
from maskfab.optics.pupil import cut, panel_aperture, polygon_cover, polygon_moments
from maskfab.optics.stop import inside, perimeter_um, stop_dots, stop_nodes, stop_strehl, widest_um
from maskfab.optics.stop_edges import edges_in_stop

HEXAGON = [(110 * np.cos(a), 95 * np.sin(a)) for a in np.pi * (np.arange(6) / 3 + 0.11)]
ARROW = [(-90.0, -70.5), (10.25, -20.0), (95.0, -88.0), (3.0, 101.0)]
STOPS = {
    "circle": Stop("circle", 210.3),
    "ellipse": Stop.ellipse(210.3, 141.7),
    "rectangle": Stop.rectangle(133.1, 207.9),
    "annulus": Stop.annulus(210.3, 97.7),
    "stretched annulus": Stop.annulus(210.3, 97.7).scaled(0.83, 1.0),
    "hexagon": Stop.polygon(HEXAGON),
    "arrow": Stop.polygon(ARROW[::-1]),
}
each_stop = pytest.mark.parametrize("stop", STOPS.values(), ids=STOPS.keys())
U = 3.7e-4 * np.arange(40)


def both_ways(u):
    return np.concatenate([-u[:0:-1], u])


def closed_form(stop, u):
    """The field of the clear stop: sincs, Airy fields, or the polygon's corners."""
    across, up = np.meshgrid(both_ways(u), both_ways(u))
    if stop.round:

        def disc(share):
            width, height = (side * share for side in stop.sides_um)
            q = np.pi * np.hypot(width * across, height * up)
            shape = np.where(q > 0, 2 * j1(q) / np.where(q > 0, q, 1), 1.0)
            return np.pi / 4 * width * height * shape

        return disc(1.0) - (disc(stop.inner_share) if stop.inner_share else 0)
    if stop.shape == "rectangle":
        width, height = stop.sides_um
        return width * height * np.sinc(width * across) * np.sinc(height * up)
    # Each side's contribution to the boundary integral, its sinc exact; the middle by the area.
    total = np.zeros(across.shape, dtype=np.complex128)
    for (px, py), (qx, qy) in zip(stop.corners_um, np.roll(stop.corners_um, -1, axis=0), strict=True):
        turn = np.exp(-1j * np.pi * (across * (px + qx) + up * (py + qy)))
        total += (across * (qy - py) - up * (qx - px)) * turn * np.sinc(across * (qx - px) + up * (qy - py))
    squared = across**2 + up**2
    middle = squared == 0
    return np.where(middle, stop.area_um2, 1j * total / (2 * np.pi * np.where(middle, 1, squared)))


def laid(seed, ratio=0.35):
    return panel(noise(6, ratio, seed), cells=6, seed=seed)


@each_stop
def test_a_clear_stop_has_the_field_of_its_shape(stop):
    clear = panel(np.ones((6, 6), dtype=np.bool_), cells=6)
    found = parity_field(cut(panel_aperture(clear), stop), U, U).amplitude()
    np.testing.assert_allclose(found, closed_form(stop, U), atol=1e-11 * stop.area_um2, rtol=0)


@each_stop
@pytest.mark.parametrize("seed", [1, 5])
def test_dots_and_polygons_go_two_ways_to_one_field(stop, seed):
    there = laid(seed)
    edges, area = edges_in_stop(clear_region(there), stop, (0.0, 0.0))
    pupil = cut(panel_aperture(there), stop)
    by_dots = parity_field(pupil, U, U).amplitude()
    by_edges = boundary(edges, area, 0.03).field(float(U[1]), by_dots.shape[0])
    assert np.linalg.norm(by_dots - by_edges) < 1e-7 * np.linalg.norm(by_dots)
    # A binary mask: its energy and its field on the axis are its area, and so is the volume under its MTF.
    assert pupil.energy_um2 == pytest.approx(area, rel=3e-8)
    assert pupil.field_integral_um2 == pytest.approx(area, rel=3e-8)
    table = lag_table(pupil)
    assert table.volume_um2 == pytest.approx(area, rel=table.uncertainty + 3e-8)


@each_stop
def test_boxes_are_cut_by_the_stop_as_one_region_of_them(stop):
    there = laid(2)
    region = clear_region(there)
    boxes = np.array(
        [
            (b.bbox().left, b.bbox().bottom, b.bbox().right, b.bbox().top)
            for b in region.decompose_trapezoids_to_region().each()
        ]
    )
    as_boxes, box_area = edges_in_stop(boxes, stop, (0.0, 0.0))
    as_region, area = edges_in_stop(region, stop, (0.0, 0.0))
    assert box_area == pytest.approx(area, rel=1e-8)
    fields = [boundary(edges, area, 0.03).field(1e-3, 31) for edges in (as_boxes, as_region)]
    assert abs(fields[0] - fields[1]).max() < 1e-7 * area


def test_one_outline_has_one_pupil_whatever_it_is_called():
    aperture = panel_aperture(laid(3))
    square, named = cut(aperture, Stop("square", 201.0)), Stop("square", 201.0).corners_um
    for other in (Stop.rectangle(201.0, 201.0), Stop.polygon(named), Stop.polygon(named[::-1])):
        found = cut(aperture, other)
        np.testing.assert_array_equal(found.whole, square.whole)
        np.testing.assert_array_equal((found.rim_row, found.rim_column), (square.rim_row, square.rim_column))
        np.testing.assert_allclose(found.rim_moments, square.rim_moments, atol=1e-14)
    round_one, ellipse = cut(aperture, Stop("circle", 201.0)), cut(aperture, Stop.ellipse(201.0, 201.0))
    np.testing.assert_array_equal(ellipse.rim_moments, round_one.rim_moments)
    many = 2 * np.pi * np.arange(512) / 512
    radius = 100.5 * np.sqrt(many[1] / np.sin(many[1]))
    by_sides = cut(aperture, Stop.polygon(radius * np.stack([np.cos(many), np.sin(many)], axis=1)))
    np.testing.assert_allclose(by_sides.mean_transmission, round_one.mean_transmission, atol=5e-4)


def test_a_polygon_along_the_lines_of_the_grid_cuts_nothing():
    corners = np.array([(0, 0), (3, 0), (3, 1), (1, 1), (1, 4), (0, 4)], dtype=np.float64) * 0.1
    lines = 0.1 * np.arange(-5, 6, dtype=np.float64)
    held, row, _ = polygon_cover(lines, lines, corners)
    assert row.size == 0
    np.testing.assert_array_equal(np.argwhere(held), [(5, 5), (5, 6), (5, 7), (6, 5), (7, 5), (8, 5)])


corner = st.tuples(st.floats(-1.3, 1.3), st.floats(-1.3, 1.3))


@examples(40)
@given(st.tuples(corner, corner, corner))
def test_moments_of_a_triangle_in_a_box_are_those_of_its_clipped_polygon(triangle):
    (ax, ay), (bx, by), (cx, cy) = triangle
    if (bx - ax) * (cy - ay) - (by - ay) * (cx - ax) < 0.05:
        return
    found = polygon_moments(np.array([[-1.0, 1.0, -1.0, 1.0]]), np.array(triangle), 4)[0]
    ring = list(triangle)
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):  # Sutherland and Hodgman
        kept = []
        for p, q in zip(ring, ring[1:] + ring[:1], strict=True):
            inner = [sign * each[axis] <= 1 for each in (p, q)]
            if inner[0]:
                kept.append(p)
            if inner[0] != inner[1]:
                t = (sign - p[axis]) / (q[axis] - p[axis])
                kept.append(tuple(a + t * (b - a) for a, b in zip(p, q, strict=True)))
        ring = kept
    if len(ring) < 3:
        np.testing.assert_allclose(found, 0, atol=1e-14)
        return
    x, y, weight = stop_nodes(Stop.polygon(ring), 8)
    expected = np.polynomial.legendre.legvander(y, 3).T @ (weight[:, None] * np.polynomial.legendre.legvander(x, 3))
    np.testing.assert_allclose(found, expected / 4, atol=1e-13)


@each_stop
def test_area_middle_and_second_moments_come_out_of_nodes_and_of_membership_alike(stop):
    x, y, weight = stop_nodes(stop)
    assert weight.sum() == pytest.approx(stop.area_um2, rel=1e-12)
    grid = (np.arange(-300, 300) + 0.5) * stop.diameter_um / 599
    held = inside(stop, grid, grid[:, None])
    cell = (grid[1] - grid[0]) ** 2
    assert held.sum() * cell == pytest.approx(stop.area_um2, rel=2e-2)
    assert (held * grid**2).sum() * cell == pytest.approx(weight @ x**2, rel=2e-2)
    assert (held * grid[:, None] ** 2).sum() * cell == pytest.approx(weight @ y**2, rel=2e-2)
    assert stop_dots(stop, 40, stop.diameter_um / 40).sum() * (stop.diameter_um / 40) ** 2 == pytest.approx(
        stop.area_um2, rel=0.06
    )


@each_stop
def test_what_a_short_move_loses_is_the_outline_seen_from_the_side(stop):
    grid = (np.arange(-300, 300) + 0.5) * stop.diameter_um / 560
    there = inside(stop, grid, grid[:, None])
    angle, cell = np.pi * np.arange(18) / 18, (grid[1] - grid[0]) ** 2
    move = 0.02 * stop.diameter_um
    lost = [
        (there & ~inside(stop, grid - move * np.cos(a), grid[:, None] - move * np.sin(a))).sum() * cell / move
        for a in angle
    ]
    assert max(lost) == pytest.approx(widest_um(stop), rel=0.05)
    # Cauchy: the mean over directions is the perimeter over π.
    assert np.mean(lost) == pytest.approx(perimeter_um(stop) / np.pi, rel=0.05)


def test_the_strehl_ratio_of_a_defocused_annulus_is_that_of_fewer_waves():
    """sinc²(W (1 - ε²)), Born and Wolf 8.8.2 over the ring's own range of phases."""
    stop = Stop.annulus(200.0, 120.0)
    found = stop_strehl(stop, lambda x, y: 0.4 * (x**2 + y**2) / 100**2)
    assert found == pytest.approx(np.sinc(0.4 * (1 - 0.36)) ** 2, rel=1e-12)


def test_a_tilted_square_is_as_bright_as_its_sincs():
    tilt = Wavefront(((2, 0.3),), 530.0).waves(Stop("square", 200.0), 530.0)
    # Noll's second term is 2x/R, so 0.3 waves of it are 1.2 waves across the side.
    assert stop_strehl(Stop("square", 200.0), tilt) == pytest.approx(np.sinc(1.2) ** 2, rel=1e-10)


def camera_of(stop_text):
    text = f'focal = "10 mm"\nstop = {stop_text}\nwavelengths = ["530 nm"]\npixel = "2 um"\nwindow = "64 um"\n'
    return parse_section(Camera, tomllib.loads(text), where="job.toml")


@pytest.mark.parametrize(
    ("text", "stop"),
    [
        ('{ shape = "ellipse", width = "4 mm", height = "3.9 mm" }', Stop.ellipse(4000.0, 3900.0)),
        ('{ shape = "rectangle", width = "1 mm", height = "3 mm" }', Stop.rectangle(1000.0, 3000.0)),
        ('{ shape = "annulus", diameter = "4 mm", inner = "1 mm" }', Stop.annulus(4000.0, 1000.0)),
        (
            '{ shape = "polygon", corners = [["1 mm", "0 mm"], ["-10 um", "-1 mm"], ["0 mm", "1 mm"]] }',
            Stop.polygon([(0.0, 1000.0), (-10.0, -1000.0), (1000.0, 0.0)]),
        ),
        ('{ diameter = "2 mm" }', Stop("circle", 2000.0)),
    ],
)
def test_a_job_states_a_stop_of_any_shape_and_writes_it_as_it_was(text, stop):
    section = camera_of(text)
    found = section.stop
    assert (found.shape, found.diameter_um, found.sides_um) == (stop.shape, stop.diameter_um, stop.sides_um)
    assert sorted(found.corners_um) == sorted(stop.corners_um)
    assert found.area_um2 == pytest.approx(stop.area_um2)
    again = parse_section(Camera, section.model_dump(mode="json", exclude_none=True), where="again")
    assert again == section


@pytest.mark.parametrize(
    ("code", "text"),
    [
        ("MF105", '{ shape = "ellipse", diameter = "4 mm" }'),
        ("MF105", '{ shape = "ellipse", width = "4 mm", height = "3 mm", inner = "1 mm" }'),
        ("MF105", '{ shape = "heart", diameter = "4 mm" }'),
        ("MF105", "{ }"),
        ("MF105", '{ shape = "polygon", corners = ["1 mm", "2 mm", "3 mm"] }'),
        ("MF103", '{ shape = "polygon", corners = [["1", "0 mm"], ["0 mm", "1 mm"], ["0 mm", "0 mm"]] }'),
        ("MF132", '{ shape = "annulus", diameter = "4 mm", inner = "4 mm" }'),
        ("MF132", '{ shape = "polygon", corners = [["1 mm", "0 mm"], ["0 mm", "1 mm"]] }'),
        ("MF132", '{ shape = "polygon", corners = [["1 mm", "0 mm"], ["1 mm", "0 mm"], ["0 mm", "1 mm"]] }'),
        (
            "MF132",
            '{ shape = "polygon", corners = [["0 mm", "0 mm"], ["1 mm", "1 mm"], ["1 mm", "0 mm"], ["0 mm", "1 mm"]] }',
        ),
        ("MF132", '{ shape = "polygon", corners = [["0 mm", "0 mm"], ["2 mm", "0 mm"], ["1 mm", "0 mm"]] }'),
        (
            "MF132",
            '{ shape = "polygon", corners = [["0 mm", "0 mm"], ["2 mm", "0 mm"], ["2 mm", "2 mm"], ["1 mm", "0 mm"], '
            '["0 mm", "2 mm"]] }',
        ),
    ],
)
def test_a_stop_that_is_none_is_refused(code, text):
    with pytest.raises(JobError) as caught:
        camera_of(text)
    assert caught.value.code == code, str(caught.value)
    assert "camera.stop" in str(caught.value) or "stop" in caught.value.where


def test_a_corner_on_a_straight_side_is_no_way_back():
    corners = '[["-1 mm", "-1 mm"], ["0 mm", "-1 mm"], ["1 mm", "-1 mm"], ["0 mm", "1 mm"]]'
    stop = camera_of(f'{{ shape = "polygon", corners = {corners} }}').stop
    assert stop.area_um2 == pytest.approx(2e6)


@pytest.mark.parametrize("count", [256, 257])
def test_a_polygon_has_256_corners_at_most(count):
    angles = 2 * np.pi * np.arange(count) / count
    corners = [[f"{1000 * np.cos(a):.3f} um", f"{1000 * np.sin(a):.3f} um"] for a in angles]
    text = f'{{ shape = "polygon", corners = {json.dumps(corners)} }}'
    if count == 256:
        assert len(camera_of(text).stop.corners_um) == count
    else:
        with pytest.raises(JobError, match=r"MF115.*257 corners are more than 256"):
            camera_of(text)


@pytest.mark.parametrize(
    "stop",
    [
        '{ shape = "ellipse", width = "400 um", height = "300 um" }',
        '{ shape = "annulus", diameter = "400 um", inner = "150 um" }',
        '{ shape = "polygon", corners = [["200 um", "10 um"], ["-120 um", "180 um"], ["-90 um", "-200 um"]] }',
    ],
)
def test_an_opening_is_analysed_behind_it_with_all_checks(stop, capsys):
    path = Path(__file__).parents[2] / "layouts" / "openings" / "toled.toml"
    command = [
        "analyse",
        str(path),
        "--camera",
        f'{{ stop = {stop}, window = "64 um", wavelengths = ["530 nm"] }}',
        "--json",
        "--quiet",
    ]
    assert run_command_line(command) == 0
    found = {each["name"]: each for each in json.loads(capsys.readouterr().out)["quantities"]}
    assert found["readback_psf_difference"]["value"] < 1e-7
    assert found["strehl_invariant_error"]["value"] < 1e-7
    assert found["peak_strehl"]["value"] == pytest.approx(found["stop_open_ratio"]["value"] ** 2, rel=1e-7)


def test_a_stop_that_is_no_table_is_refused(capsys):
    path = Path(__file__).parents[2] / "layouts" / "openings" / "toled.toml"
    assert run_command_line(["analyse", str(path), "--camera", "{ stop = ", "--quiet"]) == 2
    assert "MF101" in capsys.readouterr().err


SEARCH = """
[design]
name = "bar"
dots = 21
pitch = "168 um"
clear_dots = 100
output = "bar.toml"

[pareto]
clear_dots = [100]

[[die]]"""


@pytest.mark.parametrize("verb", [("design",), ("design", "--front", "--out", "out")], ids=["one", "front"])
def test_verbs_that_know_a_round_stop_alone_refuse_others(verb, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    ellipse = '"ellipse", width = "400 um", height = "300 um" }'
    job = write_job(tmp_path, ('"circle", diameter = "400 um" }', ellipse), ("\n[[die]]", SEARCH))
    assert run_command_line([verb[0], str(job), *verb[1:], "--quiet"]) == 2
    told = capsys.readouterr().err
    assert "MF133" in told
    assert "ellipse" in told


def test_a_relaxed_design_fills_a_stop_of_any_shape():
    """Its dots are those whose middles lie inside, whatever the shape: the same square named three ways."""
    camera = Camera(10_000.0, Stop("square", 300.0), (530.0,), 4.0, 64.0)
    corners = [(149.9, 149.9), (-149.9, 149.9), (-149.9, -149.9), (149.9, -149.9)]
    kept = [
        tiled_stop(6, 8000, np.zeros((7, 7), np.int8), replace(camera, stop=stop)).bare
        for stop in (camera.stop, Stop.rectangle(300.0, 300.0), Stop.polygon(corners))
    ]
    assert kept[0] == kept[1] == kept[2] > 1000
    ring = replace(camera, stop=Stop.annulus(300.0, 100.0))
    assert tiled_stop(6, 8000, np.zeros((7, 7), np.int8), ring).bare * 64 == pytest.approx(ring.stop.area_um2, rel=0.02)
