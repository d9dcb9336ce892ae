"""Whole plates from templates, written and read back."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest
import zxingcpp
from klayout import db
from small_job import write_job
from trips import roundtrip

from maskfab.base import resources
from maskfab.base.errors import JobError
from maskfab.base.model import CLEAR, Plate
from maskfab.mask.composition import check_clearances, templated
from maskfab.mask.formats.gdsii import write_gdsii
from maskfab.mask.formats.table import read_layout
from maskfab.mask.job import load_job
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.marks import Setting, bounding_box, load_template, modules, template_names
from maskfab.mask.raster import coverage

SIDES = 'blank = "27 mm"\nwritable = "22 mm"\n'


def job_of(folder, name: str = "5in", *edits: tuple[str, str]):
    return load_job(write_job(folder, (SIDES, f'template = "{name}"\n'), *edits))


def refused(folder, *edits: tuple[str, str]) -> JobError:
    with pytest.raises(JobError) as caught:
        load_job(write_job(folder, *edits)).plate()
    return caught.value


@pytest.fixture(scope="module")
def job(tmp_path_factory):
    return job_of(tmp_path_factory.mktemp("job"))


@pytest.fixture(scope="module")
def plate(job):
    return job.plate()


@pytest.fixture(scope="module")
def written(plate, tmp_path_factory):
    path = tmp_path_factory.mktemp("written") / "plate.gds"
    write_gdsii(plate_layout(plate), path)
    return path


def mark(plate: Plate, name: str):
    return next(each for each in plate.marks if each.name == name)


@pytest.mark.parametrize("name", template_names())
def test_every_template_takes_two_dies_and_comes_back_the_same(name, tmp_path):
    plate = job_of(tmp_path, name).plate()
    design = plate_layout(plate)
    write_gdsii(design, tmp_path / "plate.gds")
    trip = roundtrip(plate, design, tmp_path / "plate.gds")
    assert trip.differences == ()
    assert all(quantity.passed is not False for quantity in trip.quantities())
    assert [cd.read_nm for cd in trip.cds] == [gauge.target_nm for gauge in plate.gauges]
    # Bars in two places, lines at four widths both ways, two boards, three letters.
    assert len({gauge.name for gauge in plate.gauges}) == 2 * 6 + 8 + 2 + 3
    assert plate.blank_nm == 25_400_000 * int(name[0])


def test_a_board_whose_corners_touch_does_not_count_among_those_of_dies(plate, written):
    touches = [die.corner_touches for die in roundtrip(plate, plate_layout(plate), written).dies]
    without = replace(plate, marks=(), gauges=())
    bare = written.with_name("bare.gds")
    write_gdsii(plate_layout(without), bare)
    assert touches == [die.corner_touches for die in roundtrip(without, plate_layout(without), bare).dies]


def test_nothing_that_is_written_overlaps_or_leaves_the_writable_area(plate):
    whole = region(plate_layout(plate), CLEAR)
    half = plate.writable_nm // 2
    assert (whole - db.Region(db.Box(-half, -half, half, half))).is_empty()
    boxes = db.Region([db.Box(*bounding_box(each.polygons)) for each in plate.marks if each.layer is CLEAR])
    boxes += db.Region([db.Box(*die.box_nm) for die in plate.dies])
    assert boxes.merged(False, 2).is_empty()


def test_the_hash_of_the_job_is_read_from_the_written_file(job, plate, written):
    light = read_modules(plate, written)
    text = f"maskfab:{job.signature.split()[1]}:{job.digest}"
    assert np.array_equal(light, modules(text))
    picture = np.kron(light[::-1], np.ones((6, 6), bool)).astype(np.uint8) * 255
    (found,) = zxingcpp.read_barcodes(picture)
    assert found.valid
    assert found.format == zxingcpp.BarcodeFormat.DataMatrix
    assert found.text == text


@pytest.mark.parametrize("noise", [20, 50])
def test_the_code_is_read_from_a_poor_photograph(plate, written, noise):
    light = read_modules(plate, written)
    rng = np.random.default_rng(1)
    sharp = np.kron(np.pad(light[::-1], 4), np.ones((5, 5)))
    turned = np.rot90(sharp) * 160 + 40 + rng.normal(0, noise / 2, sharp.shape)
    found = zxingcpp.read_barcodes(turned.clip(0, 255).astype(np.uint8))
    assert [each.text.split(":")[0] for each in found] == ["maskfab"]


def read_modules(plate: Plate, path) -> np.ndarray:
    """Light modules of the code in a file, bool [y, x], row 0 lowest."""
    x0, y0, x1, y1 = bounding_box(mark(plate, "JOB_CODE").polygons)
    count = (x1 - x0) // 200_000
    assert (x1 - x0, y1 - y0) == (count * 200_000, count * 200_000)
    edges = np.arange(count + 1) * 200_000.0
    shares = coverage(region(read_layout(path), CLEAR, (x0, y0, x1, y1)), x0 + edges, y0 + edges)
    assert set(np.unique(shares)) <= {0.0, 1.0}
    return shares > 0.5


def test_a_mirrored_plate_is_told_by_its_parity_mark(plate, tmp_path):
    """Alone among the marks in the corners and edges, it differs from itself; fiducials and crosses do not."""
    lone = replace(plate, dies=(), gauges=(), notes=())
    lone = replace(lone, marks=tuple(each for each in plate.marks if each.kind in {"fiducial", "alignment", "parity"}))
    mirrored = plate_layout(lone)
    mirrored.transform(db.Trans.M90)
    write_gdsii(mirrored, tmp_path / "mirrored.gds")
    trip = roundtrip(lone, plate_layout(lone), tmp_path / "mirrored.gds")
    assert {difference.owner for difference in trip.differences} == {"PARITY"}
    assert trip.xor_area_um2 > 0


def test_a_job_may_say_again_what_its_template_says(job, tmp_path):
    again = load_job(write_job(tmp_path, (SIDES, 'template = "5in"\nblank = "127 mm"\nwritable = "100000 um"\n')))
    stated, bare = again.plate(), job.plate()
    assert (stated.blank_nm, stated.writable_nm) == (bare.blank_nm, bare.writable_nm)
    assert [each.name for each in stated.marks] == [each.name for each in bare.marks]


REFUSED = {
    "blank differs": ([(SIDES, 'template = "5in"\nblank = "6 in"\n')], "MF126", "plate.blank", ["152400", "127000"]),
    "writable differs": (
        [(SIDES, 'template = "5in"\nwritable = "90 mm"\n')], "MF126", "plate.writable", ["90000", "100000"],
    ),
    "unknown": ([(SIDES, 'template = "5 in"\n')], "MF125", "plate.template", ["'5 in'", "4in, 5in"]),
    "neither blank nor template": ([(SIDES, 'writable = "22 mm"\n')], "MF105", "plate.blank", ["plate.blank"]),
    "neither writable nor template": ([(SIDES, 'blank = "27 mm"\n')], "MF105", "plate.writable", ["plate.writable"]),
    "dies beyond": (
        [(SIDES, 'template = "5in"\n'), ('die_pitch = "2 mm"', 'die_pitch = "99.6 mm"')],
        "MF108", "plate.die_pitch", ["100160 um", "100000 um"],
    ),
    "die on a cross": (
        [(SIDES, 'template = "5in"\n'), ('die_pitch = "2 mm"', 'die_pitch = "94 mm"')],
        "MF126", "plate", ["PLAIN'", "mark 'ALIGN_W'"],
    ),
    "label on a mark": (
        [
            (SIDES, 'template = "4in"\ncolumns = 1\n'),
            ('die_pitch = "2 mm"', 'die_pitch = "68 mm"'),
            ("columns = 2\n", ""),
        ],
        "MF126", "plate", ["mark 'LABEL_TURNED'", "mark 'CD_"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_a_job_that_contradicts_its_template_is_refused(tmp_path, case):
    edits, code, key, said = REFUSED[case]
    error = refused(tmp_path, *edits)
    assert error.code == code
    assert f"job.toml: {key}" in error.where
    assert all(word in error.what for word in said), error.what
    assert error.cure


@pytest.mark.parametrize(
    ("old", "new", "name"),
    [
        ('room = ["2 mm", "3 mm"]', 'room = ["2 mm", "1.9 mm"]', "PARITY"),
        ('room = ["7.5 mm", "7.5 mm"]', 'room = ["6 mm", "7.5 mm"]', "JOB_CODE"),
        ('length = "3 mm"', 'length = "5 mm"', "ALIGN_W"),
        ('radius = "1.8 mm"', 'radius = "2.1 mm"', "STAR"),
        ('radius = "1.8 mm"', 'radius = "80 um"', "STAR"),
    ],
)
def test_a_mark_larger_than_its_room_is_refused(plate, tmp_path, old, new, name):
    text = resources.path("export_templates/plates/5in.toml").read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "edited.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(JobError) as caught:
        templated(load_template(path), setting_of(plate), where="job.toml: plate.template")
    assert caught.value.code == "MF126"
    assert repr(name) in caught.value.what


@pytest.mark.parametrize("feature_nm", [500, 4_033, 50_000])
@pytest.mark.parametrize("name", template_names())
def test_marks_keep_to_their_rooms_for_every_feature(plate, name, feature_nm):
    template = load_template(resources.path(f"export_templates/plates/{name}.toml"))
    setting = replace(
        setting_of(plate), feature_nm=feature_nm, blank_nm=template.blank_nm, writable_nm=template.writable_nm
    )
    drawn = templated(template, setting, where="")
    check_clearances(plate.dies, drawn.marks, template.writable_nm, where="")
    assert len({figure.name for figure in drawn.marks}) == len(drawn.marks)


def setting_of(plate: Plate) -> Setting:
    return Setting(
        title="A" * 80,
        texts=("serial A 1",),
        signature="maskfab 0.0.0 | job 0123456789abcdef | seeds none",
        digest="0" * 64,
        blank_nm=plate.blank_nm,
        writable_nm=plate.writable_nm,
        die_pitch_nm=2_000_000,
        dies=plate.dies,
        feature_nm=8_000,
    )


def test_templates_state_where_their_numbers_come_from():
    for name in template_names():
        document = tomllib.loads(resources.path(f"export_templates/plates/{name}.toml").read_text(encoding="utf-8"))
        assert "https://" in document["source"] or "choice" in document["source"]


def test_a_plate_without_a_template_has_the_marks_that_it_always_had(tmp_path):
    plate = load_job(write_job(tmp_path)).plate()
    assert [each.name for each in plate.marks] == [
        "TITLE", "LABEL_PLAIN", "LABEL_TURNED", "FIDUCIAL_SW", "FIDUCIAL_SE", "FIDUCIAL_NW", "FIDUCIAL_NE", "PARITY",
        "CD_X_1X", "CD_Y_1X", "CD_X_2X", "CD_Y_2X", "CD_X_5X", "CD_Y_5X", "OUTLINE_BLANK", "OUTLINE_WRITABLE",
        "OUTLINE_SLOT_PLAIN", "OUTLINE_SLOT_TURNED",
    ]  # fmt: skip
