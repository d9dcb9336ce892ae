"""A mask file of whatever origin is held against a job: how it lies is said exactly, and what differs is placed."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import ezdxf
import numpy as np
import pytest
from klayout import db
from PIL import Image
from small_job import command, edited, write_job

import maskfab as mf
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import CLEAR, Mark
from maskfab.findings.foreign import How, check_foreign, only_die, optics_of_like, optics_of_unlike
from maskfab.findings.optics import measure
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.mask.comparison.alignment import StatedLayers, clear_only
from maskfab.mask.formats.dxf_writer import write_dxf
from maskfab.mask.formats.format import DrawingStyle
from maskfab.mask.formats.gdsii import write_gdsii
from maskfab.mask.formats.gerber import write_gerber
from maskfab.mask.layout import clear_shapes, plate_layout, region
from maskfab.mask.raster import light_box

pytestmark = pytest.mark.usefixtures("read_here", "design_once")


MIRRORED = "mirrored left to right, as seen through the plate"


def placed(trans):
    """Put the plate below a new top cell, moved."""

    def edit(layout):
        old = layout.top_cell().cell_index()
        layout.create_cell("MOVED").insert(db.CellInstArray(old, trans))

    return edit


def flat_clear(layout):
    return db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(1, 0))).merged()


def inverted(layout):
    """Draw what is opaque instead."""
    rest = db.Region(db.Box(-11_000_000, -11_000_000, 11_000_000, 11_000_000)) - flat_clear(layout)
    for cell in layout.each_cell():
        cell.clear()
    layout.top_cells()[0].shapes(layout.layer(1, 0)).insert(rest)
    for cell in layout.top_cells()[1:]:
        cell.delete()


def rows_of(found):
    """Every quantity by its name; of dies the last."""
    return {quantity.name: quantity for quantity in found.quantities}


def told(found):
    """What every quantity says, by name; of dies the worst."""
    values = {}
    for quantity in found.quantities:
        if not isinstance(values.get(quantity.name), float) or quantity.value > values[quantity.name]:
            values[quantity.name] = quantity.value
    return values


def failed(found):
    return {quantity.name for quantity in found.quantities if quantity.passed is False}


def check(job, plate, path, **how):
    return check_foreign(plate, job.camera, job.spec.limits, path, How(**how))


@pytest.mark.parametrize("suffix", ["gds", "oas", "dxf", "gbr"])
def test_the_plate_in_whatever_form_is_the_plate(job, plate, gds, tmp_path, suffix):
    path = tmp_path / f"plate.{suffix}"
    if suffix == "dxf":
        write_dxf(plate, path, "R2010")
    elif suffix == "gbr":
        write_gerber(plate, path)
    else:
        edited(gds, path, lambda layout: layout.flatten(layout.top_cell().cell_index(), -1, True))
    found = check(job, plate, path)
    assert failed(found) == set()
    assert told(found)["lies"] == "as the design"
    assert told(found)["xor_area"] == 0
    assert {"readback_psf_difference", "mtf_difference", "cd_x_1x", "rule_width", "rule_space"} <= told(found).keys()


@pytest.mark.parametrize(
    ("turn", "said"),
    [
        (db.Trans.R90, "turned by 90 degrees counter-clockwise"),
        (db.Trans.M90, MIRRORED),
        (db.Trans.M45, "mirrored at the rising diagonal, x and y exchanged"),
        (db.Trans.M135, "mirrored at the falling diagonal"),
        (db.Trans(1234, -5), "shifted by (1.234, -0.005) um"),
        (db.Trans(2, True, 5000, 0), f"{MIRRORED} and shifted by (5, 0) um after that"),
    ],
)
def test_a_plate_that_lies_wrong_is_told_how_and_is_right_otherwise(job, plate, gds, tmp_path, turn, said):
    found = check(job, plate, edited(gds, tmp_path / "x.gds", placed(turn)))
    assert told(found)["lies"] == said
    assert failed(found) == {"lies"}
    assert told(found)["xor_area"] == 0


@pytest.mark.parametrize(
    ("factor", "said"),
    [(25.4, "drawn in millimetres, taken for inches"), (1.1, "scaled by 1.1"), (10, "10 times too large")],
)
def test_a_plate_in_another_unit_is_told(job, plate, gds, tmp_path, factor, said):
    path = edited(gds, tmp_path / "x.gds", lambda layout: layout.transform(db.DCplxTrans(factor)))
    found = check(job, plate, path)
    assert told(found)["lies"] == said
    assert told(found)["xor_area"] < 1


def test_a_plate_of_the_other_tone_is_told_and_compared_all_the_same(job, plate, gds, tmp_path):
    found = check(job, plate, edited(gds, tmp_path / "x.gds", inverted))
    assert told(found)["lies"] == "of the other tone, drawn where the design is opaque"
    assert failed(found) == {"lies"}


@pytest.mark.parametrize("step_um", [169.3344, 169.334])
def test_steps_of_a_drawing_that_would_drift_are_told(job, plate, tmp_path, step_um):
    document = ezdxf.new(units=13)
    corners = [(0, 0), (50, 0), (50, 50), (0, 50)]
    document.blocks.new("PIXEL").add_lwpolyline(corners, close=True, dxfattribs={"layer": "CLEAR"})
    steps = {"column_count": 49, "column_spacing": step_um}
    document.modelspace().add_blockref("PIXEL", (0, 0), dxfattribs=steps)
    document.saveas(tmp_path / "x.dxf")
    rows = rows_of(check(job, plate, tmp_path / "x.dxf"))
    if step_um == 169.334:
        assert "array_drift" not in rows
        return
    assert rows["array_drift"].value == pytest.approx(48 * 0.4)
    assert not rows["array_drift"].passed


def test_something_else_is_unlike_the_design_whatever_else_is_told(job, plate, tmp_path):
    layout = db.Layout()
    for x in range(40):
        layout.cell("TOP") or layout.create_cell("TOP")
        layout.cell("TOP").shapes(layout.layer(1, 0)).insert(db.Box(x * 300, 0, x * 300 + 100, 90_000))
    layout.write(str(tmp_path / "x.gds"))
    found = check(job, plate, tmp_path / "x.gds")
    assert "lies" in failed(found)
    assert told(found)["lies"].startswith("unlike the design")
    assert found.trip is None


def test_a_sliver_in_a_die_is_placed_measured_and_breaks_a_rule(job, plate, gds, tmp_path):
    die = plate.dies[1]
    x, y = die.centre_nm

    def add(layout):
        layout.top_cell().shapes(layout.layer(1, 0)).insert(db.Box(x - 60_000, y, x + 60_000, y + 300))

    found = check(job, plate, edited(gds, tmp_path / "x.gds", add))
    assert failed(found) >= {"xor_area", "rule_width", "readback_psf_difference", "mtf_difference", "readback_xor_area"}
    assert told(found)["lies"] == "as the design"
    assert 0 < told(found)["xor_area"] <= 36
    assert 1e-6 < told(found)["mtf_difference"] < 0.1
    (method,) = [quantity.method for quantity in found.quantities if quantity.name == "xor_area"]
    assert "TURNED" in method
    assert f"({(x - 60_000) / 1e3:.3f}" in method or "first at" in method
    untouched = [q for q in found.quantities if q.die == "PLAIN" and q.passed is False]
    assert untouched == []


def test_a_cd_that_is_off_by_ten_nanometres_is_told(job, plate, gds, tmp_path):
    def widen(layout):
        shapes = layout.cell("CD_X_1X").shapes(layout.layer(1, 0))
        bar = next(shapes.each()).bbox()
        shapes.insert(db.Box(bar.left, bar.bottom, bar.right + 10, bar.top))

    found = check(job, plate, edited(gds, tmp_path / "x.gds", widen))
    assert "cd_x_1x" in failed(found)
    assert "cd_x_2x" not in failed(found)
    (cd,) = [quantity for quantity in found.quantities if quantity.name == "cd_x_1x"]
    assert cd.value == cd.limit + 10


def test_one_die_of_a_plate_and_one_die_alone_are_compared_with_the_die(job, plate, gds, tmp_path):
    one = only_die(plate, "TURNED")
    assert failed(check(job, one, gds)) == set()
    found = check(job, one, gds, cell="TURNED")
    assert failed(found) == {"lies"}
    assert told(found)["xor_area"] == 0
    other = check(job, only_die(plate, "PLAIN"), gds, cell="TURNED")
    assert failed(other) - {"lies"} or not other.alignment.alike


def test_a_picture_of_a_die_has_no_place_to_be_wrong_at(job, plate, tmp_path):
    one = only_die(plate, "TURNED")
    die = one.dies[0]
    box = db.Box(*die.box_nm)
    clear = region(plate_layout(one), CLEAR)
    side = box.width() // 8000
    pixels = np.zeros((side, side), dtype=np.uint8)
    for polygon in clear.decompose_trapezoids_to_region().each():
        part = polygon.bbox().moved(-box.left, -box.bottom)
        pixels[part.bottom // 8000 : part.top // 8000, part.left // 8000 : part.right // 8000] = 255
    for path, picture in ((tmp_path / "right.png", pixels), (tmp_path / "turned.png", np.rot90(pixels))):
        Image.fromarray(picture[::-1]).save(path)
    assert failed(check(job, one, tmp_path / "right.png", dots_per_um=0.125)) == set()
    turned = check(job, one, tmp_path / "turned.png", dots_per_um=0.125)
    assert failed(turned) == {"lies"}
    assert told(turned)["lies"].startswith("turned by 90 degrees")
    with pytest.raises(SourceError, match="MF314"):
        check(job, one, tmp_path / "right.png")


def test_a_die_that_is_not_there_is_refused(plate):
    with pytest.raises(JobError, match=r"MF105.*'NONE'.*PLAIN, TURNED"):
        only_die(plate, "NONE")


def test_the_command_tells_and_exits_with_the_verdict(capsys, gds, tmp_path):
    job = write_job(tmp_path)
    good = command(capsys, "verify", gds, "--against", job, "--json", "--quiet")
    assert (good.code, good.document["verdict"]) == (0, "pass")
    path = edited(gds, tmp_path / "<i>turned.gds", placed(db.Trans.M90))
    bad = command(capsys, "verify", path, "--against", job, "--json", "--quiet")
    assert (bad.code, bad.document["verdict"]) == (1, "fail")
    (lies,) = [quantity for quantity in bad.document["quantities"] if quantity["name"] == "lies"]
    assert lies["value"].startswith("mirrored left to right")


def test_the_command_tells_people_too(capsys, gds, tmp_path):
    path = edited(gds, tmp_path / "turned.gds", placed(db.Trans.M90))
    shown = command(capsys, "verify", path, "--against", write_job(tmp_path), "--die", "PLAIN", "--quiet")
    assert shown.code == 1
    assert "FAIL lies = mirrored left to right" in shown.stderr


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        ((), "MF105"),
        (("--against", "JOB", "--die", "NONE"), "MF105"),
        (("--against", "JOB", "--layer", "7/7"), "MF306"),
        (("--against", "JOB", "--cell", "NONE"), "MF307"),
        (("--against", "missing.toml"), "MF301"),
    ],
)
def test_the_command_refuses_what_it_cannot_do(capsys, gds, tmp_path, arguments, code):
    job = write_job(tmp_path)
    shutil.copy(gds, tmp_path / "x.gds")
    spoken = [job if argument == "JOB" else argument for argument in arguments]
    answer = command(capsys, "verify", tmp_path / "x.gds", *spoken, "--quiet", "--json")
    assert answer.code == 2
    assert answer.document["error"]["code"] == code


# --- files that are far from any design ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "shape", [db.Text("nothing but a text", db.Trans(0, 0)), db.Box(0, 0, 0, 0)], ids=["text", "no area"]
)
def test_a_file_in_which_nothing_is_clear_is_refused(job, plate, tmp_path, shape):
    path = drawn_alone(tmp_path / "dark.gds", shape)
    with pytest.raises(SourceError, match=r"MF30[69]"):
        check_foreign(plate, job.camera, job.spec.limits, path)


def test_a_black_picture_is_refused(job, plate, tmp_path):
    path = tmp_path / "black.png"
    Image.new("L", (40, 40)).save(path)
    with pytest.raises(SourceError, match="MF309"):
        check_foreign(plate, job.camera, job.spec.limits, path, How(dots_per_um=0.125))


@pytest.mark.parametrize("side", [1, 1000, 100_000])
def test_a_shape_at_the_end_of_the_world_is_unlike_the_design(job, plate, tmp_path, side):
    far = 900_000_000
    path = drawn_alone(tmp_path / "far.gds", db.Box(far, far, far + side, far + side))
    found = check_foreign(plate, job.camera, job.spec.limits, path)
    assert not found.alignment.alike


def test_what_a_layer_takes_out_of_what_is_clear_fails_unless_the_house_takes_it_so(job, plate, gds, tmp_path):
    """A square too many on 1/0 and once more on 2/0: houses that are told of one layer expose it."""
    more = db.Box(3_000_000, 3_000_000, 3_100_000, 3_100_000)

    def edit(layout):
        for layer in (1, 2):
            layout.top_cell().shapes(layout.layer(layer, 0)).insert(more)

    path = edited(gds, tmp_path / "x.gds", edit)
    rows = {
        cut: rows_of(check_foreign(plate, job.camera, job.spec.limits, path, ordered=StatedLayers(cut=cut)))[
            "layer_taken_out"
        ]
        for cut in (False, True)
    }
    assert (rows[False].passed, rows[True].passed) == (False, True)
    assert "[export] shop" in rows[False].method
    stated = rows_of(check(job, plate, path, layer="1/0"))
    assert stated["xor_area"].passed is False
    assert stated["other_layers"].passed is False
    assert "layer_taken_out" not in stated


def in_turned_cells(*angles: float, beside=None):
    """Put the plate below cells turned one after the other, with a shape in the innermost of them."""

    def edit(layout):
        old = layout.top_cell().cell_index()
        if beside is not None:
            layout.top_cell().shapes(layout.layer(1, 0)).insert(beside)
        for level, angle in enumerate(angles):
            above = layout.create_cell(f"TURNED_{level}")
            above.insert(db.CellInstArray(old, db.ICplxTrans(1.0, angle, False, 0, 0)))
            old = above.cell_index()

    return edit


def test_cells_turned_by_half_right_angles_and_back_reach_no_further(job, plate, gds, tmp_path):
    path = edited(gds, tmp_path / "x.gds", in_turned_cells(45, -45))
    assert failed(check(job, plate, path)) == set()


def test_what_reaches_beyond_the_blank_does_so_in_turned_cells_too(job, plate, gds, tmp_path):
    """By as much: a square whose corner is 100 um outside."""
    corner = plate.blank_nm // 2 + 100_000
    square = db.Box(corner - 40_000, corner - 40_000, corner, corner)
    path = edited(gds, tmp_path / "x.gds", in_turned_cells(45, 45, -90, beside=square))
    found = check(job, plate, path)
    assert failed(found) >= {"rule_extent", "xor_area"}
    assert told(found)["rule_extent"] == pytest.approx(100, abs=2e-3)


def widened(plate, by_nm):
    """Move the right side of the bars of a gauge, and that of dots of a die."""

    def edit(layout):
        for cell in (layout.cell("CD_X_1X"), next(c for c in layout.each_cell() if c.name.startswith("RING"))):
            shapes = cell.shapes(layout.layer(1, 0))
            box = next(shapes.each()).bbox()
            shapes.insert(db.Box(box.right, box.bottom, box.right + by_nm, box.top))
            shape = db.Region(shapes).merged(True, 1)
            shapes.clear()
            shapes.insert(shape)

    return edit


def test_edges_off_by_the_tolerance_are_slivers_and_off_by_twice_that_faults(job, plate, gds, tmp_path):
    one, two = (edited(gds, tmp_path / f"{by_nm}.gds", widened(plate, by_nm)) for by_nm in (1, 2))
    strict = check(job, plate, one)
    assert failed(strict) >= {"xor_area", "cd_x_1x", "readback_xor_area", "readback_wrong_dots"}
    found = check(job, plate, one, tolerance_nm=1.0)
    assert failed(found) & {"xor_area", "cd_x_1x", "readback_xor_area", "readback_wrong_dots"} == set()
    sliver = rows_of(found)["sliver_area"]
    assert sliver.value == pytest.approx(told(strict)["xor_area"])
    assert "the widest of at most 1 nm" in sliver.method
    wide = check(job, plate, two, tolerance_nm=1.0)
    assert failed(wide) >= {"xor_area", "cd_x_1x", "readback_xor_area"}
    assert rows_of(wide)["sliver_area"].value == 0


ARMS = [
    db.Polygon([db.Point(0, 0), db.Point(x, y), db.Point(x + 3001, y + 4007)]).moved(5_000_000, 5_000_000)
    for x, y in ((90_001, 20_003), (-70_001, 50_021), (-30_007, -80_009), (61_001, -47_013))
]


def in_trapezoids(shift):
    """Slanted arms beside the plate, as trapezoids on the nanometre grid."""
    pieces = db.Region(ARMS).decompose_trapezoids_to_region().moved(shift, 0)
    return lambda layout: layout.top_cell().shapes(layout.layer(1, 0)).insert(pieces)


def test_a_fracture_into_trapezoids_differs_by_slivers_alone(job, plate, gds, tmp_path):
    """Corners that it makes on slanted edges are rounded. Arms as a whole off by 2 nm are a fault all the same."""
    arms = tuple(tuple((point.x, point.y) for point in arm.each_point_hull()) for arm in ARMS)
    marked = replace(plate, marks=(*plate.marks, Mark("ARMS", "resolution", CLEAR, arms)))
    right, off = (edited(gds, tmp_path / f"{shift}.gds", in_trapezoids(shift)) for shift in (0, 2))
    strict = check(job, marked, right)
    assert "xor_area" in failed(strict)
    found = check(job, marked, right, tolerance_nm=1.0)
    assert failed(found) == set()
    assert 0 < rows_of(found)["sliver_area"].value == pytest.approx(told(strict)["xor_area"])
    assert "xor_area" in failed(check(job, marked, off, tolerance_nm=1.0))


def test_a_tolerance_that_would_hide_faults_is_refused(capsys, gds, tmp_path):
    job = write_job(tmp_path)
    for tolerance, code in (("1 um", "MF104"), ("-1 nm", "MF104"), ("1", "MF103")):
        answer = command(capsys, "verify", gds, "--against", job, "--tolerance", tolerance, "--json")
        assert (answer.code, answer.document["error"]["code"]) == (2, code), tolerance


@pytest.fixture(scope="module")
def two_layers(gds, tmp_path_factory):
    """The plate, and a square as large as a dot on another datatype."""
    path = tmp_path_factory.mktemp("layers") / "x.gds"
    square = db.Box(40_000, 40_000, 48_000, 48_000)
    return edited(gds, path, lambda layout: layout.top_cell().shapes(layout.layer(1, 5)).insert(square))


def test_shapes_on_a_layer_that_the_job_has_not_fail_unless_it_is_said_that_they_are_not_written(
    job, plate, two_layers
):
    found = check(job, plate, two_layers)
    assert failed(found) == {"other_layers"}
    assert "1/5" in rows_of(found)["other_layers"].method
    assert found.layers.others == ("1/5",)
    assert failed(check(job, plate, two_layers, ignored=("1/5",))) == set()
    assert failed(check(job, plate, two_layers, ignored=("1/4", "5"))) == {"other_layers"}


def test_texts_and_the_layers_that_the_job_has_for_people_are_no_fault(job, plate, gds, tmp_path):
    def label(layout):
        layout.top_cell().shapes(layout.layer(63, 0)).insert(db.Text("CHECKED", db.Trans(0, 0)))
        layout.top_cell().shapes(layout.layer(10, 0)).insert(db.Box(0, 0, 9, 9))

    found = check(job, plate, edited(gds, tmp_path / "x.gds", label))
    assert failed(found) == set()
    assert "10/0" in rows_of(found)["passed_over"].method


@pytest.mark.parametrize("layer", [(7, 0), (1, 3)])
def test_a_plate_on_another_layer_than_ordered_fails_unless_that_layer_is_stated(job, plate, tmp_path, layer):
    path = tmp_path / "moved.oas"
    layout = plate_layout(plate)
    layout.set_info(layout.find_layer(1, 0), db.LayerInfo(*layer))
    for index in layout.layer_indexes():
        if not layout.get_info(index).is_equivalent(db.LayerInfo(*layer)):
            layout.delete_layer(index)
    layout.write(str(path))
    found, name = check(job, plate, path), "/".join(map(str, layer))
    assert failed(found) == {"layer"}
    row = rows_of(found)["layer"]
    assert (row.value, row.limit.split()[0]) == (name, "1/0")
    assert failed(check(job, plate, path, layer=name)) == set()


def test_a_house_calls_its_layers_as_it_likes(job, plate, tmp_path):
    names = {"CLEAR": "MASK_1", "NOTE": "TEXT", "OUTLINE": "FRAME"}
    write_dxf(plate, tmp_path / "x.dxf", "R2010", style=DrawingStyle(layer_names=names))
    ordered = StatedLayers(names)
    found = check_foreign(plate, job.camera, job.spec.limits, tmp_path / "x.dxf", ordered=ordered)
    assert failed(found) == set()
    assert found.layers.clear == "MASK_1"
    with pytest.raises(SourceError, match="MF306"):
        check(job, plate, tmp_path / "x.dxf")


def test_a_tone_that_is_stated_is_asked_of_the_file(job, plate, gds, tmp_path):
    path = edited(gds, tmp_path / "x.gds", inverted)
    assert failed(check(job, plate, path)) == {"lies"}
    assert failed(check(job, plate, path, dark=True)) == set()
    right = check(job, plate, gds, dark=True)
    assert failed(right) == {"lies"}
    assert told(right)["lies"] == "of the other tone, drawn where the design is clear"
    assert "--tone" in rows_of(right)["lies"].method


def test_the_first_line_and_the_document_tell_layer_and_tone(capsys, two_layers, tmp_path):
    job = write_job(tmp_path)
    shown = command(capsys, "verify", two_layers, "--against", job, "--quiet")
    first = shown.stdout.splitlines()[0]
    assert "1/0" in first
    assert "are clear" in first
    assert "1/5" in first
    answer = command(capsys, "verify", two_layers, "--against", job, "--ignore", "1/5", "--quiet", "--json")
    keys = [*answer.document][:5]
    assert keys == ["verdict", "verdicts", "layer", "tone", "other_layers"]
    assert [answer.document[key] for key in keys if key != "verdicts"] == ["pass", "1/0 CLEAR", "clear", []]
    grey = command(capsys, "verify", two_layers, "--against", job, "--tone", "grey", "--json")
    assert (grey.code, grey.document["error"]["code"], grey.document["error"]["where"]) == (2, "MF105", "--tone")


def test_the_function_tells_layer_and_tone_as_the_command_does(two_layers, tmp_path):
    job = write_job(tmp_path)
    found = mf.verify(two_layers, against=job)
    assert (found.layer, found.tone, found.other_layers) == ("1/0 CLEAR", "clear", ("1/5",))
    assert not found.passed
    assert mf.verify(two_layers, against=job, ignore=["1/5"]).other_layers == ()
    with pytest.raises(JobError, match=r"MF103 .*\(tolerance\)"):
        mf.verify(two_layers, against=job, tolerance="1 furlong")


def test_who_holds_one_die_against_a_plate_is_told_how(job, plate, tmp_path):
    path = tmp_path / "die.gds"
    write_gdsii(plate_layout(replace(plate, dies=plate.dies[1:], marks=(), gauges=(), notes=())), path)
    rows = {row.name: row for row in check_foreign(plate, job.camera, job.spec.limits, path).quantities}
    assert rows["lies"].passed is False
    assert "--die" in rows["lies"].method


def drawn_alone(path: Path, shape) -> Path:
    layout = db.Layout()
    layout.create_cell("TOP").shapes(layout.layer(1, 0)).insert(shape)
    layout.write(str(path))
    return path


def test_a_leak_that_the_job_states_is_part_of_what_a_file_does_to_light(job, plate):
    """Told of the polygons of a file as of the die they are, and not without the leak."""
    leaking, die = MaskBlank(1.5, 0.5), plate.dies[0]
    design = plate_layout(plate)
    clear_only(design, Path("x.gds"))
    shapes = clear_shapes(design, light_box(die, job.camera.stop))
    expected = {row.name: row.value for row in measure(die, job.camera, shapes, leaking).quantities}
    found, opaque = (
        {row.name: row for row in optics_of_unlike(plate, job.camera, blank, design, design) if row.die == die.name}
        for blank in (leaking, UNSTATED)
    )
    for name in ("peak_strehl", "auc_radial_min", "psf_energy_in_window"):
        assert found[name].value == pytest.approx(expected[name], rel=1e-5)
        assert found[name].value != pytest.approx(opaque[name].value, rel=1e-2)
    assert found["mtf_difference"].passed
    alike = list(optics_of_like(die, job.camera, leaking, design, design, equal=True))
    assert {row.name for row in alike} >= {"readback_psf_difference", "mtf_difference"}
    assert all(row.passed is not False for row in alike)
