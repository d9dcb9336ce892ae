"""Rows on how a DXF was read: its unit, the fate of its entities, and the error of its chords."""

from __future__ import annotations

import math

import ezdxf
import pytest

from maskfab.findings.analysis import Request, analyse
from maskfab.job.camera import Camera, Stop

CAMERA = Camera(10_000.0, Stop("circle", 1000.0), (530.0,), 2.0)


def rows(path, draw, unit, **how):
    document = ezdxf.new("R2010", units=unit)
    draw(document.modelspace())
    document.saveas(path)
    return {one.name: one for one in analyse(path, Request(CAMERA, **how)).quantities}


def test_an_assumed_unit_is_said_and_a_stated_one_named(tmp_path):
    def draw(m):
        m.add_lwpolyline([(-50, -50), (50, -50), (50, 50), (-50, 50)], close=True)

    told = rows(tmp_path / "x.dxf", draw, 0)["drawing_unit"]
    assert told.value == "1 um, assumed"
    assert "say --unit" in told.method
    told = rows(tmp_path / "x.dxf", draw, 0, unit_um=2.0)["drawing_unit"]
    assert (told.value, "as --unit states" in told.method) == ("2 um", True)
    told = rows(tmp_path / "x.dxf", draw, 13)["drawing_unit"]
    assert (told.value, "as $INSUNITS states" in told.method) == ("1 um", True)


def test_a_ring_of_circles_tells_its_error_its_entities_and_what_parity_makes_of_it(tmp_path):
    def draw(m):
        for radius in (300, 100):
            m.add_circle((7, 7), radius)
        m.add_text("A")
        m.add_linear_dim(base=(0, -20), p1=(-10, 0), p2=(10, 0)).render()

    told = rows(tmp_path / "x.dxf", draw, 13)
    ratio = told["stop_open_ratio"]
    assert 0 < ratio.value - 0.36 + ratio.uncertainty < 2 * ratio.uncertainty < 2e-5
    assert told["area_by_parity"].value == pytest.approx(math.pi * 1e4, abs=0.0017 * 628)
    assert told["entities_read"].method.endswith("2 CIRCLE on 0 as curves")
    assert told["entities_left_out"].method.endswith("1 DIMENSION on 0, 1 TEXT on 0")


def test_the_mtf_of_who_fills_by_parity_is_that_of_a_fill_that_leaves_islands_open(tmp_path):
    def outlines(m):
        for side in (300, 100):
            m.add_lwpolyline([(-side, -side), (side, -side), (side, side), (-side, side)], close=True)

    def fill(m):
        hatch = m.add_hatch()
        for side, flags in ((300, 1), (100, 16)):
            hatch.paths.add_polyline_path(
                [(-side, -side), (side, -side), (side, side), (-side, side)], is_closed=True, flags=flags
            )

    told, ring = (rows(tmp_path / f"{draw.__name__}.dxf", draw, 13) for draw in (outlines, fill))
    assert told["mtf50_by_parity"].value == pytest.approx(ring["mtf50"].value, rel=1e-9)
    assert told["mtf50"].value != pytest.approx(ring["mtf50"].value, rel=1e-2)
    assert "mtf50_by_parity" not in ring
