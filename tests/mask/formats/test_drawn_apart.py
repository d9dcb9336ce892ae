"""DXF with more than polygons: curves, fills, chains, widths, and blocks placed by any map, against exact areas."""

from __future__ import annotations

import itertools
import math

import ezdxf
import numpy as np
import pytest
from ezdxf.addons import r12writer
from ezdxf.math import BSpline, rational_bspline_from_arc
from hypothesis import given, settings
from hypothesis import strategies as st
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR
from maskfab.mask.formats.content import Conversion, array_drift, find_layer, rounding_nm
from maskfab.mask.formats.drawing import drawing_notes
from maskfab.mask.formats.dxf_curves import CHORD_NM, spline
from maskfab.mask.formats.dxf_process import content
from maskfab.mask.formats.gdstk_process import cell_content
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import layer_info, left_out, region

ON_CLEAR = {"layer": "CLEAR"}
FROM_BELOW = {"extrusion": (0, 0, -1)}
UM2 = 1e6


def drawing(path, draw, version="R2010", unit=13):
    document = ezdxf.new(version, units=unit)
    draw(document.modelspace())
    document.saveas(path)
    return path


def fast(path):
    """As read apart, in this process."""
    read = content(path, 1000.0)
    named = [layer_info(CLEAR) if name == "CLEAR" else db.LayerInfo(name) for name in read.layers]
    return Conversion(path, named).layout([cell_content(cell) for cell in read.cells]), read


def clear_um2(path):
    return region(fast(path)[0], CLEAR).area() / UM2


def square(x, y, side=10.0):
    return [(x, y), (x + side, y), (x + side, y + side), (x, y + side)]


# --- curves: within their chords of the exact area -------------------------------------------------------------------


def rounded(m):
    m.add_lwpolyline(
        [(0, 0, 0), (40, 0, math.tan(math.pi / 8)), (50, 10, 0), (0, 10, 0)],
        format="xyb",
        close=True,
        dxfattribs=ON_CLEAR,
    )


def bulged_r12(m):
    m.add_polyline2d([(0, 0, 1), (100, 0, 1)], format="xyb", close=True, dxfattribs=ON_CLEAR)


def arcs(m):
    for start in (0, 120, 240):
        m.add_arc((5, 5), 50, start, start + 120, dxfattribs=ON_CLEAR)


def ellipse_and_line(m):
    m.add_ellipse((0, 0), (100, 0), 0.5, 0, math.pi, dxfattribs=ON_CLEAR)
    m.add_line((-100, 0), (100, 0), dxfattribs=ON_CLEAR)


def spline_circle(m):
    curve = rational_bspline_from_arc((0, 0), 100, 0, 360)
    m.add_rational_spline(curve.control_points, curve.weights(), curve.degree, curve.knots(), dxfattribs=ON_CLEAR)


def slot(m):
    m.add_arc((0, 0), 10, 90, 270, dxfattribs=ON_CLEAR)
    m.add_line((0, -10), (50, -10), dxfattribs=ON_CLEAR)
    m.add_arc((50, 0), 10, 270, 90, dxfattribs=ON_CLEAR)
    m.add_lwpolyline([(50, 10), (20, 10), (0, 10)], dxfattribs=ON_CLEAR)


CURVES = {
    "circle": (lambda m: m.add_circle((3, 4), 100, dxfattribs=ON_CLEAR), math.pi * 1e4, 628.4),
    "circle from below": (lambda m: m.add_circle((3, 4), 100, dxfattribs=ON_CLEAR | FROM_BELOW), math.pi * 1e4, 628.4),
    "ellipse": (lambda m: m.add_ellipse((0, 0), (80, 60), 0.3, dxfattribs=ON_CLEAR), math.pi * 3e3, 440),
    "bulge": (rounded, 500 - 100 + math.pi * 25, 120),
    "two bulges of R12": (bulged_r12, math.pi * 2500, 314.2),
    "arcs": (arcs, math.pi * 2500, 314.2),
    "half ellipse": (ellipse_and_line, math.pi * 2500, 450),
    "rational spline": (spline_circle, math.pi * 1e4, 628.4),
    "slot": (slot, 1000 + math.pi * 100, 163),
}


@pytest.mark.parametrize("version", ["R12", "R2010"])
@pytest.mark.parametrize("kind", CURVES)
def test_a_curve_has_its_area_within_its_chords(tmp_path, kind, version):
    draw, area, perimeter = CURVES[kind]
    if version == "R12" and kind not in {"circle", "circle from below", "two bulges of R12", "arcs"}:
        return  # has no such entity
    layout, read = fast(drawing(tmp_path / "x.dxf", draw, version))
    within = (CHORD_NM + math.sqrt(0.5)) / 1e3 * perimeter
    assert abs(region(layout, CLEAR).area() / UM2 - area) < within
    assert read.curves > 0
    assert not read.faults


@given(
    st.lists(st.tuples(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5), st.floats(0.1, 10)), min_size=5, max_size=9),
    st.integers(1, 4),
)
@settings(max_examples=30, deadline=None)
def test_no_point_of_a_spline_is_further_from_its_chords_than_is_told(control, degree):
    places = np.array(control)
    curve = BSpline([(x, y) for x, y, _ in control], order=degree + 1, weights=list(places[:, 2]))
    chords = spline(places[:, :2], places[:, 2], np.array(curve.knots()), degree)
    points = np.array([tuple(point)[:2] for point in curve.points(np.linspace(0, curve.max_t, 500))])
    start, step = chords[:-1], np.diff(chords, axis=0)
    length = np.maximum((step**2).sum(1), 1e-30)
    share = np.clip(((points[:, None] - start) * step).sum(2) / length, 0, 1)
    apart = np.linalg.norm(points[:, None] - start - share[..., None] * step, axis=2).min(axis=1)
    assert apart.max() <= CHORD_NM * 1.001


def test_a_closed_spline_without_clamped_ends_is_drawn_over_its_domain(tmp_path):
    corners = [(0, 0), (100, 0), (100, 100), (0, 100)]

    def draw(m):
        curve = m.add_spline(dxfattribs=ON_CLEAR)
        curve.control_points = [*corners, *corners[:3]]
        curve.knots = list(range(len(corners) + 3 + 4))
        curve.dxf.degree = 3

    t = np.linspace(0, 1, 2001)[:-1]
    basis = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1) / 6
    spans = [basis @ np.array([(*corners, *corners)[k + j] for j in range(4)]) for k in range(4)]
    area = shoelace([tuple(point) for point in np.concatenate(spans)]) / UM2
    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == pytest.approx(area, abs=0.6)


@pytest.mark.parametrize("weight", [1e-6, 1e-3, 1e3, 1e6])
def test_a_spline_of_uneven_weights_takes_few_points(tmp_path, weight):
    def draw(m):
        control = [(0, 0), (50, 100), (100, 0)]
        m.add_rational_spline(control, [1, weight, 1], 2, [0, 0, 0, 1, 1, 1], dxfattribs=ON_CLEAR)
        m.add_lwpolyline([(100, 0), (100, -10), (0, -10), (0, 0)], dxfattribs=ON_CLEAR)

    layout, _ = fast(drawing(tmp_path / "x.dxf", draw))
    # A conic of that weight (Farin, Curves and Surfaces for CAGD, 12.3): area by Simpson's rule.
    t = np.linspace(0, 1, 200_001) ** 3
    t = np.concatenate([t / 2, 1 - t[::-1] / 2])
    below = (1 - t) ** 2 + 2 * weight * t * (1 - t) + t**2
    x, y = (100 * weight * t * (1 - t) + 100 * t**2) / below, 200 * weight * t * (1 - t) / below
    assert region(layout, CLEAR).area() / UM2 == pytest.approx(1000 + np.trapezoid(y, x), abs=0.5)
    assert sum(polygon.num_points() for polygon in region(layout, CLEAR).each()) < 5000


# --- fills -----------------------------------------------------------------------------------------------------------


def fill(m, style=0):
    hatch = m.add_hatch(dxfattribs=ON_CLEAR | {"hatch_style": style})
    for at, side in ((0, 100), (20, 60), (40, 20)):
        hatch.paths.add_polyline_path(square(at, at, side), is_closed=True)


@pytest.mark.parametrize(("style", "area"), [(0, 10_000 - 3600 + 400), (1, 10_000 - 3600), (2, 10_000)])
def test_a_fill_leaves_its_islands_open_as_its_style_says(tmp_path, style, area):
    assert clear_um2(drawing(tmp_path / "x.dxf", lambda m: fill(m, style))) == area


def test_a_fill_is_bounded_by_edges_of_every_kind(tmp_path):
    def draw(m):
        hatch = m.add_hatch(dxfattribs=ON_CLEAR)
        outer = hatch.paths.add_edge_path()
        outer.add_line((0, 0), (100, 0))
        outer.add_arc((100, 50), 50, -90, 90)
        outer.add_line((100, 100), (0, 100))
        outer.add_ellipse((0, 50), (0, 50), 0.5, 0, 180)
        inner = hatch.paths.add_edge_path(flags=16)
        inner.add_arc((50, 50), 10, 0, 360, ccw=False)

    area = 10_000 + math.pi * 1250 + math.pi * 625 - math.pi * 100
    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == pytest.approx(area, abs=0.9)


@pytest.mark.parametrize("below", [False, True])
def test_ends_of_elliptic_edges_are_angles_from_their_axis(tmp_path, below):
    # As LibreCAD reads them too, and acadrust since its issue 178; of an ELLIPSE they are parameters.
    start, stop = math.radians(30), math.radians(120)

    def draw(m):
        boundary = m.add_hatch(dxfattribs=ON_CLEAR | (FROM_BELOW if below else {})).paths.add_edge_path()
        boundary.add_ellipse((0, 0), (100, 0), 0.5, *map(math.degrees, (start, stop)))
        for angle, add in ((stop, (0, 0)), (start, (0, 0))):
            reach = 50 / math.hypot(0.5 * math.cos(angle), math.sin(angle))
            boundary.add_line((reach * math.cos(angle), reach * math.sin(angle)), add)

    turn = [math.atan2(math.sin(angle) / 0.5, math.cos(angle)) for angle in (start, stop)]
    area = 100 * 50 / 2 * (turn[1] - turn[0])
    layout, read = fast(drawing(tmp_path / "x.dxf", draw))
    assert region(layout, CLEAR).area() / UM2 == pytest.approx(area, abs=0.3)
    assert read.curves == 1


def test_islands_of_islands_are_filled_by_their_style(tmp_path):
    def draw(style):
        def fills(m):
            for x in (0, 500):
                hatch = m.add_hatch(dxfattribs=ON_CLEAR | {"hatch_style": style})
                for k, flags in enumerate((1, 16, 0, 1, 4)):
                    corners = square(x + 10 * k, 10 * k, 100 - 20 * k)
                    hatch.paths.add_polyline_path(corners, is_closed=bool(k % 2), flags=flags)

        return fills

    for style, area in enumerate((10_000 - 6400 + 3600 - 1600 + 400, 3600, 10_000)):
        assert clear_um2(drawing(tmp_path / f"{style}.dxf", draw(style))) == 2 * area


def test_a_bulge_of_a_fill_counts_as_a_curve(tmp_path):
    def draw(m):
        m.add_hatch(dxfattribs=ON_CLEAR).paths.add_polyline_path([(0, 0, 1), (1, 0, 1)], is_closed=True)

    layout, read = fast(drawing(tmp_path / "x.dxf", draw))
    assert region(layout, CLEAR).area() / UM2 == pytest.approx(math.pi / 4, abs=0.006)
    assert read.curves == 2


def test_faces_and_traces_are_polygons(tmp_path):
    def draw(m):
        m.add_3dface([(0, 0), (10, 0), (10, 10), (0, 10)], dxfattribs=ON_CLEAR)
        m.add_3dface([(20, 0, 5), (30, 0, 5), (30, 10, 5)], dxfattribs=ON_CLEAR)
        m.add_trace([(40, 0), (50, 0), (40, 10), (50, 10)], dxfattribs=ON_CLEAR)

    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == 250


# --- chains ----------------------------------------------------------------------------------------------------------


def lines(*points, attributes=ON_CLEAR):
    def draw(m):
        for one, other in itertools.pairwise(points):
            m.add_line(one, other, dxfattribs=attributes)

    return draw


def test_lines_that_close_are_an_outline_in_whatever_order(tmp_path):
    def draw(m):
        for one, other in (((0, 0), (10, 0)), ((10, 10), (10, 0)), ((0, 10), (0, 0)), ((10, 10), (0, 10))):
            m.add_line(one, other, dxfattribs=ON_CLEAR)
        m.add_line((10, 0), (0, 0), dxfattribs=ON_CLEAR)  # twice, the other way
        m.add_line((5, 5), (5, 5), dxfattribs=ON_CLEAR)  # no length

    layout, read = fast(drawing(tmp_path / "x.dxf", draw))
    assert region(layout, CLEAR).area() / UM2 == 100
    assert {one.read_as: one.count for one in read.read_as} == {
        "a part of an outline": 4,
        "nothing, for it repeats another": 1,
        "nothing, for it has no length": 1,
    }


def test_a_gap_is_joined_and_told_if_it_is_small(tmp_path):
    # In millimetres: of lone ends a thousandth of them is 1 um.
    near = drawing(tmp_path / "a.dxf", lines((0, 0), (1, 0), (1, 1), (0, 0.0008)), unit=4)
    far = drawing(tmp_path / "b.dxf", lines((0, 0), (1, 0), (1, 1), (0, 0.002)), unit=4)
    layout = read_layout(near)
    assert drawing_notes(layout).gap_nm == pytest.approx(800)
    assert region(layout, CLEAR).area() / UM2 == pytest.approx(5e5, abs=800)
    with pytest.raises(
        SourceError, match=r"MF310 .*1 end lies alone at \(0, .*\), 2000 nm from the next; 1000 nm are joined"
    ):
        read_layout(far)


def test_lines_that_branch_are_refused_where_they_do(tmp_path):
    path = drawing(tmp_path / "x.dxf", lines((0, 0), (10, 0), (10, 10), (0, 0), (-7, 3)))
    with pytest.raises(SourceError, match=r"MF310 x\.dxf draws 4 x LINE .*\(3 ends meet at \(0, 0\)\).*PEDIT"):
        read_layout(path)


def outlines(*corner_lists):
    def draw(m):
        for corners in corner_lists:
            lines(*corners, corners[0])(m)

    return draw


def test_outlines_of_lines_that_touch_at_corners_are_filled(tmp_path):
    path = drawing(tmp_path / "x.dxf", outlines(square(0, 0), square(10, 10), square(20, 0), square(10, -50)))
    assert clear_um2(path) == 400


@pytest.mark.parametrize(
    "corner_lists",
    [
        [square(0, 0, 20), [(0, 0), (8, 3), (3, 8)]],  # one within the other, at its corner
        # Overlapping squares, cut where they cross.
        [
            [(0, 0), (10, 0), (10, 5), (10, 10), (5, 10), (0, 10)],
            [(10, 5), (15, 5), (15, 15), (5, 15), (5, 10), (5, 5)],
        ],
    ],
)
def test_outlines_of_lines_that_could_be_filled_in_two_ways_are_refused(tmp_path, corner_lists):
    with pytest.raises(SourceError, match=r"MF310 .*4 ends meet at"):
        read_layout(drawing(tmp_path / "x.dxf", outlines(*corner_lists)))


# --- lines with a width ----------------------------------------------------------------------------------------------

CORNER = [(0, 0), (100, 0), (100, 100)]
WIDE = {
    "one width": (CORNER, 10, 10, False, 2000),
    "a ring": (square(0, 0, 100), 10, 10, True, 110**2 - 90**2),
    "tapered": ([(0, 0), (100, 0)], 10, 30, False, 2000),
}


@pytest.mark.parametrize("kind", ["LWPOLYLINE", "POLYLINE"])
@pytest.mark.parametrize("what", WIDE)
def test_a_line_with_a_width_has_its_area(tmp_path, kind, what):
    points, start, end, closed, area = WIDE[what]

    def draw(m):
        rows = [(x, y, start, end) for x, y in points]
        add = m.add_lwpolyline if kind == "LWPOLYLINE" else m.add_polyline2d
        add(rows, format="xyse", close=closed, dxfattribs=ON_CLEAR)

    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == area


def test_a_width_along_an_arc_is_a_ring(tmp_path):
    def draw(m):
        m.add_lwpolyline([(-50, 0, 20, 20, 1), (50, 0, 20, 20, 1)], format="xyseb", close=True, dxfattribs=ON_CLEAR)

    area = math.pi * (60**2 - 40**2)
    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == pytest.approx(area, abs=2 * math.pi * 100 * 0.0018)


@pytest.mark.parametrize("matrix", [(1, 1), (-2, 0.5)])
def test_a_width_along_an_arc_ends_square_to_it(tmp_path, matrix):
    def draw(m):
        space = m.doc.blocks.new("ARC")
        space.add_lwpolyline([(-50, 0, 20, 20, 1), (50, 0, 20, 20, 0)], format="xyseb", dxfattribs=ON_CLEAR)
        space.add_lwpolyline([(200, 0, 0, 100, 0.02), (300, 0, 0, 0, 0)], format="xyseb", dxfattribs=ON_CLEAR)
        m.add_blockref("ARC", (0, 0), dxfattribs={"xscale": matrix[0], "yscale": matrix[1]})

    drawn = region(fast(drawing(tmp_path / "x.dxf", draw))[0], CLEAR)
    turn = 2 * math.atan(0.02)
    corners = sorted(matrix[0] * x for x in (-60, 300 + 50 * math.sin(turn)))
    bottom, top = sorted(matrix[1] * y for y in (-60, 50 * math.cos(turn)))
    box = drawn.bbox()
    found = [box.left, box.right, box.bottom, box.top]
    assert found == pytest.approx([1000 * side for side in (*corners, bottom, top)], abs=4)


def test_a_line_wider_than_its_arc_is_the_whole_of_it(tmp_path):
    def draw(m):
        m.add_lwpolyline([(-10, 0, 30, 30, 1), (10, 0, 30, 30, 0)], format="xyseb", dxfattribs=ON_CLEAR)

    area = math.pi / 2 * (25**2 + 5**2)
    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == pytest.approx(area, abs=0.2)


def test_a_line_of_two_widths_is_refused(tmp_path):
    def draw(m):
        rows = [(0, 0, 10, 10), (100, 0, 10, 10)]
        m.add_lwpolyline(rows, format="xyse", dxfattribs=ON_CLEAR | {"const_width": 20})

    with pytest.raises(SourceError, match=r"MF311 .*LWPOLYLINE of two widths"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


def test_widths_that_change_at_vertices_of_r12(tmp_path):
    head = "0\nSECTION\n2\nENTITIES\n0\nPOLYLINE\n8\nCLEAR\n66\n1\n70\n0\n"
    rows = "".join(
        f"0\nVERTEX\n8\nCLEAR\n10\n{x}\n20\n0\n40\n{width}\n41\n{width}\n" for x, width in ((0, 10), (50, 30), (100, 0))
    )
    path = tmp_path / "x.dxf"
    path.write_text(f"{head}{rows}0\nSEQEND\n0\nENDSEC\n0\nEOF\n")
    assert region(read_layout(path), CLEAR).area() / UM2 == 2000


# --- blocks ----------------------------------------------------------------------------------------------------------

SCALES = st.sampled_from([1, -1, 2, 0.5, -3, 1.001])
PLACES = st.tuples(
    st.floats(-500, 500), st.floats(-500, 500), SCALES, SCALES, st.sampled_from([0, 90, 180, 270, 30, -45.5]),
    st.integers(1, 3), st.integers(1, 2), st.booleans(),
)  # fmt: skip
PIXEL = [(-10, -10), (10, -10), (10, 10), (-10, 30)]
BASE = (3, -2)


def moved(points, place):
    """Own arithmetic: all copies of points of a block, in the block or drawing that places it."""
    x, y, xscale, yscale, degrees, columns, rows, below = place
    turn = complex(math.cos(math.radians(degrees)), math.sin(math.radians(degrees)))
    copies = []
    for column in range(columns):
        for row in range(rows):
            shift = complex(x, y) + turn * complex(column * 70, row * 90)
            own = [shift + turn * complex(xscale * (u - BASE[0]), yscale * (v - BASE[1])) for u, v in points]
            copies.append([(-p.real if below else p.real, p.imag) for p in own])
    return copies


@given(PLACES, PLACES)
@settings(max_examples=60, deadline=None)
def test_blocks_in_blocks_lie_where_the_product_of_their_maps_says(tmp_path_factory, inner, outer):
    def draw(m):
        pixel, die = (m.doc.blocks.new(name, base_point=BASE) for name in ("PIXEL", "DIE"))
        pixel.add_lwpolyline(PIXEL, close=True)  # on layer 0
        for space, name, place in ((die, "PIXEL", inner), (m, "DIE", outer)):
            x, y, xscale, yscale, degrees, columns, rows, below = place
            space.add_blockref(
                name, (x, y), dxfattribs={
                    "layer": "CLEAR" if space is m else "0", "xscale": xscale, "yscale": yscale, "rotation": degrees,
                    "column_count": columns, "row_count": rows, "column_spacing": 70, "row_spacing": 90,
                    **(FROM_BELOW if below else {}),
                },
            )  # fmt: skip

    layout, _ = fast(drawing(tmp_path_factory.mktemp("blocks") / "x.dxf", draw))
    expected = sorted(
        [round(1000 * sum(x for x, _ in p) / 4), round(1000 * sum(y for _, y in p) / 4), shoelace(p)]
        for die in moved(PIXEL, inner)
        for p in moved(die, outer)
    )
    found = sorted(
        [
            sum(p.x for p in polygon.each_point_hull()) / 4,
            sum(p.y for p in polygon.each_point_hull()) / 4,
            polygon.area(),
        ]
        for polygon in unmerged(layout)
    )
    assert len(found) == len(expected)
    for one in expected:
        assert any(
            abs(one[0] - other[0]) < 3 and abs(one[1] - other[1]) < 3 and abs(one[2] - other[2]) < 3e-4 * one[2]
            for other in found
        )


def shoelace(points):
    twice = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(points, [*points[1:], points[0]], strict=True))
    return abs(twice) / 2 * UM2


def unmerged(layout):
    drawn = db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(layer_info(CLEAR))))
    drawn.merged_semantics = False
    return drawn.each()


def test_a_circle_in_a_block_of_unequal_scales_is_an_ellipse(tmp_path):
    def draw(m):
        m.doc.blocks.new("HOLE").add_circle((0, 0), 10, dxfattribs=ON_CLEAR)
        m.doc.blocks.new("DIE").add_blockref("HOLE", (0, 0), dxfattribs={"rotation": 30})
        m.add_blockref("DIE", (5, 5), dxfattribs={"xscale": 20, "yscale": -3})

    layout, _ = fast(drawing(tmp_path / "x.dxf", draw))
    assert region(layout, CLEAR).area() / UM2 == pytest.approx(math.pi * 6000, abs=0.0017 * 850)
    assert rounding_nm(layout) == 0


@pytest.mark.parametrize("turned", [False, True])
def test_steps_of_an_array_off_the_grid_do_not_add_up(tmp_path, turned):
    def draw(m):
        m.doc.blocks.new("DOT").add_lwpolyline(square(0, 0, 1), close=True, dxfattribs=ON_CLEAR)
        steps = {"column_count": 49, "column_spacing": 169.3344, "row_count": 3, "row_spacing": 5}
        m.add_blockref("DOT", (0, 0), dxfattribs=steps | ({"rotation": 90} if turned else {}))

    layout = read_layout(drawing(tmp_path / "x.dxf", draw))
    box = layout.top_cell().bbox()
    assert (box.top if turned else box.right) == round(48 * 169_334.4) + 1000
    drift_nm, which = array_drift(layout)
    assert drift_nm == pytest.approx(48 * 0.4)
    assert which == "copy 49 of cell DOT in an array"


def test_steps_of_an_array_on_the_grid_are_those_of_klayout(tmp_path, monkeypatch):
    def draw(m):
        m.doc.blocks.new("DOT").add_lwpolyline(square(0, 0, 1e-3), close=True, dxfattribs=ON_CLEAR)
        m.add_blockref("DOT", (0, 0), dxfattribs={"column_count": 49, "column_spacing": 0.169334})

    monkeypatch.delattr("maskfab.mask.formats.dxf.read_apart")
    layout = read_layout(drawing(tmp_path / "x.dxf", draw, unit=4))
    assert layout.top_cell().bbox().right == 48 * 169_334 + 1000


def test_a_block_that_is_clipped_is_refused(tmp_path):
    from ezdxf.xclip import XClip

    def draw(m):
        m.doc.blocks.new("PART").add_lwpolyline(square(0, 0), close=True, dxfattribs=ON_CLEAR)
        XClip(m.add_blockref("PART", (0, 0), dxfattribs=ON_CLEAR)).set_block_clipping_path([(0, 0), (5, 5)])

    with pytest.raises(SourceError, match=r"MF317 x\.dxf draws 1 x INSERT that is clipped"):
        read_layout(drawing(tmp_path / "x.dxf", draw))


def test_a_text_on_its_edge_is_passed_over(tmp_path):
    def draw(m):
        m.add_circle((0, 0), 10, dxfattribs=ON_CLEAR)
        m.add_text("A", dxfattribs=ON_CLEAR | {"extrusion": (1, 0, 0)})

    assert clear_um2(drawing(tmp_path / "x.dxf", draw)) == pytest.approx(100 * math.pi, abs=0.1)


def test_a_line_in_space_has_no_plane_of_its_own(tmp_path):
    def draw(m):
        line = m.add_polyline3d([(0, 0, 0), (10, 0, 0), (10, 20, 0)], close=True, dxfattribs=ON_CLEAR)
        line.dxf.extrusion = (0, 0, -1)

    layout, _ = fast(drawing(tmp_path / "x.dxf", draw))
    assert region(layout, CLEAR).bbox() == db.Box(0, 0, 10_000, 20_000)


# --- names, units, layers --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Bemaßung", "图层一"])
@pytest.mark.parametrize("version", ["R2000", "R2004", "R2010"])
def test_names_of_any_letters_are_read_in_the_code_page_of_the_file(tmp_path, name, version):
    document = ezdxf.new(version, units=13)
    document.encoding = "cp1252" if name.startswith("B") else "gbk"
    for layer, x in (("CLEAR", 0), (name, 100)):
        document.modelspace().add_lwpolyline(square(x, 0), close=True, dxfattribs={"layer": layer})
    document.saveas(tmp_path / "x.dxf")
    layout = read_layout(tmp_path / "x.dxf")
    assert region(layout, CLEAR).area() == 1e8
    assert region(layout, find_layer(layout, name)).area() == 1e8


def test_layers_of_one_name_in_other_letters_are_one(tmp_path):
    def draw(m):
        for layer, x in (("CLEAR", 0), ("Clear", 20)):
            m.add_lwpolyline(square(x, 0), close=True, dxfattribs={"layer": layer})

    assert region(read_layout(drawing(tmp_path / "x.dxf", draw)), CLEAR).area() == 2e8
    alone = drawing(
        tmp_path / "y.dxf", lambda m: m.add_lwpolyline(square(0, 0), close=True, dxfattribs={"layer": "clear"})
    )
    layout = read_layout(alone)
    assert region(layout, find_layer(layout, "Clear")).area() == 1e8


def test_r12_without_a_header_is_read(tmp_path):
    with r12writer(tmp_path / "x.dxf") as file:
        file.add_polyline_2d(square(0, 0), closed=True, layer="CLEAR")
    layout = read_layout(tmp_path / "x.dxf")
    assert region(layout, CLEAR).area() == 1e8
    assert drawing_notes(layout).unit_said_by == ""


def test_a_layer_that_cannot_be_read_is_refused_once_it_is_asked_for(tmp_path):
    def draw(m):
        m.add_circle((0, 0), 10, dxfattribs={"layer": "CUT_OUT"})
        m.add_line((0, 0), (50, 0), dxfattribs={"layer": "FOLD"})
        m.add_text("A", dxfattribs={"layer": "NOTES"})

    layout = read_layout(drawing(tmp_path / "x.dxf", draw))
    assert find_layer(layout, "cut_out").name == "CUT_OUT"
    with pytest.raises(SourceError, match=r"MF306 .*CUT_OUT.*FOLD"):
        find_layer(layout)
    with pytest.raises(SourceError, match=r"MF310 x\.dxf draws 1 x LINE on layer 'FOLD' \(1 end lies alone at"):
        find_layer(layout, "FOLD")
    told = {(one.kind, one.layer): one.read_as for one in drawing_notes(layout).read_as}
    assert told == {("CIRCLE", "CUT_OUT"): "curves", ("TEXT", "NOTES"): ""}
    assert left_out(layout).curves == 1


def solid(entity):
    entity.sat = ["400 0 1 0", "kept by the modeller alone"]


@pytest.mark.parametrize(
    ("draw", "said"),
    [
        (lambda m: solid(m.add_region(dxfattribs=ON_CLEAR)), "MF311 .*REGION.*closed polylines"),
        (lambda m: solid(m.add_3dsolid(dxfattribs=ON_CLEAR)), "MF311 .*3DSOLID"),
        (lambda m: m.add_line((0, 0, 0), (1, 0, 5), dxfattribs=ON_CLEAR), "MF317 .*LINE out of the plane.*FLATTEN"),
        (lambda m: m.add_hatch(dxfattribs=ON_CLEAR).set_pattern_fill("ANSI31"), "MF310 .*HATCH of a pattern"),
        (lambda m: m.add_spline([(0, 0), (9, 9), (9, 0)], dxfattribs=ON_CLEAR), "MF311 .*without control points"),
    ],
)
def test_what_no_polygon_can_be_made_of_is_named_with_a_cure(tmp_path, draw, said):
    def beside(m):
        m.add_circle((0, 0), 10, dxfattribs=ON_CLEAR)
        draw(m)

    with pytest.raises(SourceError, match=said):
        read_layout(drawing(tmp_path / "x.dxf", beside, "R2000"))


def test_areas_of_a_plain_drawing_are_those_of_its_text(tmp_path, monkeypatch):
    def draw(m):
        part = m.doc.blocks.new("PART")
        part.add_lwpolyline(square(0, 0), close=True)  # on layer 0: that of the reference
        m.doc.blocks.new("DIE").add_blockref("PART", (0, 0), dxfattribs={"column_count": 3, "column_spacing": 20})
        m.add_blockref("DIE", (0, 0), dxfattribs=ON_CLEAR)
        for side in (10, 4):  # one within the other
            m.add_lwpolyline(square(100, 100, side), close=True, dxfattribs=ON_CLEAR)

    path = drawing(tmp_path / "x.dxf", draw)
    assert region(read_layout(path), CLEAR).area() / UM2 == 400
    monkeypatch.setattr("maskfab.mask.formats.dxf._POLYLINE_MODE", 3)  # takes one away from the other
    with pytest.raises(SourceError, match=r"MF316 x\.dxf draws polygons of 416 um\^2 by its text and 384 um\^2"):
        read_layout(path)


def test_a_cell_that_has_the_name_of_its_block_is_drawn_as_its_block_is(tmp_path):
    def draw(m):
        m.doc.blocks.new("PART").add_lwpolyline(square(0, 0), close=True, dxfattribs=ON_CLEAR)
        for x, angle in ((0, 30), (50, 0), (100, 90)):
            m.add_blockref("PART", (x, 0), dxfattribs={"rotation": angle})

    layout, _ = fast(drawing(tmp_path / "x.dxf", draw))
    assert sorted(cell.name for cell in layout.each_cell()) == ["PART", "PART$0", "TOP"]
    assert layout.cell("PART").bbox() == db.Box(0, 0, 10_000, 10_000)


@pytest.mark.parametrize("end", [b"\x1a", b"\r\n\x1a\0\0\0"])
def test_a_last_block_that_is_filled_up_is_no_part_of_a_drawing(tmp_path, end):
    for draw in (lambda m: m.add_circle((0, 0), 10, dxfattribs=ON_CLEAR), outlines(square(0, 0))):
        path = drawing(tmp_path / "x.dxf", draw)
        path.write_bytes(path.read_bytes() + end)
        assert not region(read_layout(path), CLEAR).is_empty()


@pytest.mark.parametrize("name", ["7", "L7", "L7D0", "0"])
def test_a_layer_called_like_a_number_is_found_by_it_however_it_is_read(tmp_path, name):
    on = {"layer": name}
    plain = drawing(tmp_path / "a.dxf", lambda m: m.add_lwpolyline(square(0, 0), close=True, dxfattribs=on))
    apart = drawing(tmp_path / "b.dxf", lines(*square(0, 0), (0, 0), attributes=on))
    for layout in map(read_layout, (plain, apart)):
        number = "0" if name == "0" else "7"
        assert region(layout, find_layer(layout, number)).area() / UM2 == 100
        assert region(layout, find_layer(layout, f"{number}/0")).area() / UM2 == 100
