"""Designed MTFs along an edge's normal, against those of the point PSF, and what is told of a measured one beside."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from optics_cases import camera, noise, panel, pupil
from slanted_edges import noisy, rendered, second_integral, windowed_mtf

from maskfab.base.model import ORIENTATIONS, orient
from maskfab.camera.inspection.edge_mtf import (
    EdgeDesign,
    MtfCurve,
    designed_mtf,
    differences,
    measured_edges,
    mtf50,
    normal_in_die,
)
from maskfab.camera.inspection.slanted_edge import FLAT, FREQUENCIES
from maskfab.optics.psf import point_psf
from maskfab.optics.spectrum import Band, Curve
from maskfab.report.documents.report import report_text
from maskfab.report.pages.measured import edges_document, edges_drawing

CAMERA = camera(1000.0, window_um=1800.0)
# Dots so large that nearly all light falls within the window of the PSF; without any symmetry.
PANEL = panel(noise(4, 0.4, 3), dot_nm=60_000, cells=6)
LINE_NM = 530.0


@pytest.fixture(scope="module")
def psf():
    # Points half a pixel apart: a sum of points repeats its spectrum at 2 cycles per pixel.
    return point_psf(pupil(PANEL, CAMERA.stop), replace(CAMERA, pixel_um=1.0), LINE_NM)


@pytest.mark.parametrize("normal_deg", [5.0, -38.0, 97.0])
def test_a_designed_curve_is_that_of_the_point_psf_through_one_window(psf, normal_deg):
    found = designed_mtf(PANEL, CAMERA, LINE_NM, FREQUENCIES, normal_deg, half_px=60.0)
    second = second_integral(psf, CAMERA.pixel_um, normal_deg)
    expected = windowed_mtf(FREQUENCIES, normal_deg, second, 60.0, FLAT)
    # A share of 1.4 % of the light falls outside the PSF's window.
    np.testing.assert_allclose(found.seen, expected, atol=4e-3)
    assert abs(found.seen - found.mtf).max() > 0.01
    assert found.seen[0] == pytest.approx(1)


@pytest.mark.parametrize("orientation", range(ORIENTATIONS))
def test_a_turned_die_is_looked_up_along_the_normal_in_its_own_axes(orientation):
    """Of a unit that fills the stop, a turned panel is one of the turned unit."""
    mask = noise(24, 0.4, 5)
    own, turned = (panel(each, dot_nm=60_000, cells=2) for each in (mask, orient(mask, orientation)))
    found = designed_mtf(own, CAMERA, LINE_NM, FREQUENCIES, 20.0, orientation=orientation)
    expected = designed_mtf(turned, CAMERA, LINE_NM, FREQUENCIES, 20.0)
    np.testing.assert_allclose(found.mtf, expected.mtf, atol=found.uncertainty + expected.uncertainty + 1e-9)
    assert normal_in_die(20.0, 0) == 20.0


def test_a_band_of_light_is_the_mean_over_its_lines():
    band = Band((Curve(np.array([500.0, 540.0, 580.0]), np.array([0.0, 1.0, 0.0]), "green"),), "green")
    found = designed_mtf(PANEL, CAMERA, band, FREQUENCIES, 5.0)
    lines, weights = np.linspace(500, 580, 321), 1 - abs(np.linspace(500, 580, 321) - 540) / 40
    one = [designed_mtf(PANEL, CAMERA, line, FREQUENCIES[::3], 5.0).mtf for line in lines[4:-4:8]]
    # The pupil is not negative, nor is its autocorrelation: moduli may be averaged.
    expected = np.average(one, axis=0, weights=weights[4:-4:8])
    assert expected[1:12].min() > 0.01
    np.testing.assert_allclose(found.mtf[::3], expected, atol=3e-3)
    assert found.light == "green"


@pytest.fixture(scope="module")
def measured(psf):
    light = rendered(400, 200, 5.0, second_integral(psf, CAMERA.pixel_um, 5.0))
    return measured_edges(noisy(light, 1), CAMERA.pixel_um, design=EdgeDesign("NOISE", PANEL, CAMERA, (LINE_NM,)))


def test_a_right_die_does_not_part_from_its_design_and_a_wrong_one_does(measured):
    (edge,) = measured.edges
    numbers = {each.name: each for each in edge.quantities}
    assert numbers["edge_mtf_parting"].value is None
    assert numbers["edge_mtf_difference"].value < 2 * numbers["edge_mtf_difference"].uncertainty
    assert numbers["edge_angle"].value == pytest.approx(-5.0, abs=0.01)
    assert numbers["edge_mtf50"].uncertainty < 5
    other = panel(noise(4, 0.4, 9), dot_nm=60_000, cells=6)
    (wrong,) = EdgeDesign("NOISE", other, CAMERA, (LINE_NM,)).along(
        FREQUENCIES, edge.edge.normal_deg, edge.edge.half_px
    )
    difference, parting = differences(edge.edge, wrong)
    assert difference.value > 3 * difference.uncertainty
    assert 0 < parting.value < 250


def test_a_curve_from_elsewhere_is_held_against_the_design():
    (designed,) = EdgeDesign("NOISE", PANEL, CAMERA, (LINE_NM,)).along(FREQUENCIES, 0.0, None)
    curve = MtfCurve("curve.csv", CAMERA.pixel_um, FREQUENCIES, designed.mtf + 0.02, None, None)
    (difference,) = differences(curve, designed)
    assert difference.value == pytest.approx(0.02)
    assert difference.uncertainty is None
    half, per_pixel = mtf50(MtfCurve("line.csv", 2.0, FREQUENCIES, 1 - FREQUENCIES, None, None))
    assert half.value == pytest.approx(250.0)
    assert per_pixel.value == pytest.approx(0.5)
    assert mtf50(MtfCurve("flat.csv", 2.0, FREQUENCIES, np.ones(129), None, None))[0].value is None


def test_the_document_and_the_figure_show_every_curve(measured):
    document = edges_document(measured)
    assert report_text(document)
    (edge,) = document["edges"]
    assert len(edge["mtf"]) == len(edge["low"]) == len(edge["frequency_cy_per_mm"]) == len(edge["designed"][0]["seen"])
    assert edge["frequency_cy_per_mm"][-1] == pytest.approx(500.0)
    assert document["die"] == "NOISE"
    assert document["left_out"] == []
    drawing = edges_drawing(measured, "edge.tif")
    svg = drawing.svg()
    assert svg == edges_drawing(measured, "edge.tif").svg()
    for word in ("measured", "95 % band", "designed, 530 nm", "horizontal, edge −5.00°", "cycles/pixel", "edge.tif"):
        assert word in svg, word
    assert "NOISE" in drawing.words
