"""A DXF in another unit than it says is read again in the right one, told to be wrong, and compared exactly."""

from __future__ import annotations

import ezdxf
import pytest
from klayout import db
from small_job import command, look, with_the_die, write_job
from sweeps import sweep

from maskfab.base.errors import JobError
from maskfab.base.model import CLEAR
from maskfab.findings.foreign import How, check_foreign
from maskfab.mask.job import Job, load_job
from maskfab.mask.layout import plate_layout, region

pytestmark = pytest.mark.usefixtures("read_here", "design_once")

MICROMETRES, MILLIMETRES, INCHES = 13, 4, 1


@pytest.fixture(scope="module")
def job(tmp_path_factory) -> Job:
    """One die of 3 x 3 cells behind a small stop: drawings of many outlines are slow to write and to read."""
    edits = (('"400 um"', '"100 um"'), ('"560 um"', '"168 um"'))
    return load_job(with_the_die("PLAIN", write_job(tmp_path_factory.mktemp("job"), *edits)))


@pytest.fixture(scope="module")
def polygons(job):
    """Corners of all that is clear, in um."""
    shapes = region(plate_layout(job.plate()), CLEAR).decompose_trapezoids_to_region().each()
    return [[(point.x / 1e3, point.y / 1e3) for point in shape.each_point_hull()] for shape in shapes]


def drawn(path, polygons, um_per_unit, header, extra=None):
    document = ezdxf.new("R12" if header is None else "R2010")
    if header is not None:
        document.header["$INSUNITS"] = header
    modelspace = document.modelspace()
    add = modelspace.add_polyline2d if header is None else modelspace.add_lwpolyline
    for points in polygons:
        add([(x / um_per_unit, y / um_per_unit) for x, y in points], close=True, dxfattribs={"layer": "CLEAR"})
    if extra:
        extra(modelspace)
    document.saveas(path)
    return path


def told(job, path, **how):
    found = check_foreign(job.plate(), job.camera, job.spec.limits, path, How(**how))
    return {quantity.name: quantity for quantity in found.quantities}, {
        quantity.name for quantity in found.quantities if quantity.passed is False
    }


@pytest.mark.parametrize(
    ("um_per_unit", "header", "said", "unit"),
    sweep(
        [
            (25400.0, None, "drawn in inches, taken for micrometres (state --unit in)", "in"),
            (1.0, 12, "1000 times too small (state --unit um)", "um"),
            (1000.0, INCHES, "drawn in millimetres, taken for inches (state --unit mm)", "mm"),
            (25400.0, MILLIMETRES, "drawn in inches, taken for millimetres (state --unit in)", "in"),
            (1000.0, MICROMETRES, "1000 times too small (state --unit mm)", "mm"),
        ],
        3,
    ),
)
def test_another_unit_is_told_and_undone_before_anything_is_rounded(
    job, polygons, tmp_path, um_per_unit, header, said, unit
):
    path = drawn(tmp_path / "x.dxf", polygons, um_per_unit, header)
    quantities, failed = told(job, path)
    assert failed == {"lies"}
    assert quantities["lies"].value == said
    assert f"read again in {unit}" in quantities["lies"].method
    assert (quantities["xor_area"].value, quantities["rounding"].value) == (0, 0)
    assert quantities["empty_polygons"].value == 0
    assert told(job, path, unit_um=um_per_unit)[1] == set()


def test_a_stated_unit_that_is_wrong_is_told_as_any_other(job, polygons, tmp_path):
    path = drawn(tmp_path / "x.dxf", polygons, 1.0, MICROMETRES)
    quantities, failed = told(job, path, unit_um=25.4)
    assert "lies" in failed
    assert quantities["lies"].value != "as the design"


def test_what_differs_is_told_in_the_right_unit(job, polygons, tmp_path):
    path = drawn(tmp_path / "x.dxf", polygons[1:], 25400.0, None)
    quantities, failed = told(job, path)
    missing = db.DPolygon([db.DPoint(*point) for point in polygons[0]]).area()
    assert "xor_area" in failed
    assert quantities["xor_area"].value == pytest.approx(missing)


def test_a_solid_beside_the_plate_is_the_only_difference(job, polygons, tmp_path):
    corners = [(0, 3000), (10, 3000), (0, 3010), (10, 3010)]
    path = drawn(
        tmp_path / "x.dxf", polygons, 1.0, MICROMETRES, lambda m: m.add_solid(corners, dxfattribs={"layer": "CLEAR"})
    )
    quantities, _ = told(job, path)
    assert quantities["lies"].value == "as the design"
    assert quantities["xor_area"].value == 100


def test_texts_on_the_clear_layer_fail_and_elsewhere_do_not(job, polygons, tmp_path):
    def noted(layer):
        def extra(modelspace):
            modelspace.add_text("REV A", dxfattribs={"layer": layer})
            modelspace.add_mtext("REV B", dxfattribs={"layer": layer})

        return extra

    quantities, failed = told(job, drawn(tmp_path / "x.dxf", polygons, 1.0, MICROMETRES, noted("CLEAR")))
    assert (quantities["texts"].value, failed) == (2, {"texts"})
    quantities, failed = told(job, drawn(tmp_path / "y.dxf", polygons, 1.0, MICROMETRES, noted("NOTES")))
    assert (quantities["texts"].value, failed) == (0, set())


def test_labels_of_gdsii_are_noted(job, tmp_path):
    layout = plate_layout(job.plate())
    layout.top_cell().shapes(layout.find_layer(1, 0)).insert(db.Text("REV A", 0, 0))
    layout.write(str(tmp_path / "x.gds"))
    quantities, failed = told(job, tmp_path / "x.gds")
    assert (quantities["texts"].value, quantities["texts"].passed, failed) == (1, None, set())


def test_the_command_takes_a_unit(capsys, job, polygons, tmp_path):
    path, stated = drawn(tmp_path / "x.dxf", polygons, 25400.0, None), job.where
    wrong = command(capsys, "verify", path, "--against", stated, "--quiet")
    assert wrong.code == 1
    assert "FAIL lies = drawn in inches, taken for micrometres (state --unit in)" in wrong.stderr
    right = command(capsys, "verify", path, "--against", stated, "--unit", "in", "--quiet", "--json")
    assert (right.code, right.document["verdict"]) == (0, "pass")


@pytest.mark.parametrize("arguments", [("verify", "--against", "JOB"), ("analyse",)])
def test_the_commands_refuse_units_that_cannot_be(capsys, polygons, tmp_path, arguments):
    verb, *more = [write_job(tmp_path) if argument == "JOB" else argument for argument in arguments]
    dxf = drawn(tmp_path / "x.dxf", polygons[:1], 1.0, MICROMETRES)
    answer = command(capsys, verb, dxf, *more, "--unit", "furlong", "--quiet", "--json")
    assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")
    for name in ("x.gds", "x.png"):
        (tmp_path / name).write_bytes(b"1234")
        answer = command(capsys, verb, tmp_path / name, *more, "--unit", "mm", "--quiet", "--json")
        assert (answer.code, answer.document["error"]["code"]) == (2, "MF105")


def test_analyse_takes_a_unit(capsys, polygons, tmp_path):
    shapes = [[(x + dx, y) for x, y in ((0, 0), (8, 0), (8, 8), (0, 8))] for dx in range(0, 80, 16)]
    optics = (*look(stop={"diameter": "60 um"}), "--json")
    ratios = []
    for scale, unit in ((1.0, "um"), (25400.0, "in")):
        path = drawn(tmp_path / f"{unit}.dxf", shapes, scale, None)
        answer = command(capsys, "analyse", path, "--unit", unit, *optics)
        ratios += [q["value"] for q in answer.document["quantities"] if q["name"] == "stop_open_ratio"]
    assert len(ratios) == 2
    assert ratios[0] == ratios[1] > 0


def test_a_stated_unit_is_for_drawings_only(job, tmp_path):
    plate_layout(job.plate()).write(str(tmp_path / "x.gds"))
    with pytest.raises(JobError, match="MF105"):
        told(job, tmp_path / "x.gds", unit_um=1.0)
