"""A bias taken out of the data: once, exactly, in every format, and told."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from klayout import db
from small_job import with_the_die, write_job

from maskfab.base.errors import JobError, OutputError
from maskfab.base.model import CLEAR, Die, Opening, Panel, Plate, Tiling
from maskfab.job.shop import parse_shop
from maskfab.mask.comparison.files import compare_mask, read_mask
from maskfab.mask.comparison.roundtrip import biased_raster
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.formats.table import products
from maskfab.mask.houses.files import files_of_job
from maskfab.mask.houses.order import check_offers, order_of
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.layout import plate_layout, region
from maskfab.mask.package.pack import compare_shops, pack, verify_package
from maskfab.mask.raster import coverage
from maskfab.mask.writer import biased_data, written_of
from maskfab.runs.pipeline import run
from maskfab.runs.verification import verify, verify_file

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

ALL = 'formats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg"]'
TEMPLATE = ('blank = "27 mm"\nwritable = "22 mm"\n', 'template = "5in"\n')
GDSII = ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]')
SAID = (".txt", ".html", ".csv", ".json", ".svg")
BARS = """name = "bars"
pitch = "56 um"
dots = 7
grid = '''
.......
.##....
.##....
.##.##.
....##.
.......
.......
'''
"""


def biased(folder, bias_um: float = 0.4, *edits, order: str = "", export: str = "", **job):
    """The die of the small job that is turned at random, its data biased."""
    path = with_the_die("TURNED", write_job(folder, *edits, **job))
    said = f'[order]\nbias = "data"\n{order}\n[process]\ncd_bias = "{bias_um} um"\n'
    path.write_text(path.read_text() + (f"\n[export]\n{export}\n" if export else "\n") + said)
    return load_job(path)


@pytest.mark.parametrize(
    ("tone", "chrome", "bias_um", "edits"),
    [
        ("clear", "up", 0.4, ()),
        pytest.param("dark", "down", -0.6, (TEMPLATE,), marks=pytest.mark.slow),
        pytest.param("dark", "up", 0.2, (TEMPLATE,), marks=pytest.mark.slow),
    ],
)
def test_every_format_is_the_design_once_its_writer_has_made_it(tmp_path, tone, chrome, bias_um, edits):
    job = biased(tmp_path, bias_um, *edits, order=f'tone = "{tone}"\nchrome = "{chrome}"', export=ALL)
    made = files_of_job(job.plate(), job.spec, ["made for a test"])
    for product in made.products:
        path = tmp_path / product.name
        product.write(path)
        trip = compare_mask(made, read_mask(path), path)
        rows = trip.quantities()
        assert [row for row in rows if row.passed is False] == []
        assert {"data_bias", "data_xor_area", "data_wrong_parts", "data_width_error"} <= {row.name for row in rows}
        assert all(die.wrong_dots == 0 for die in trip.dies)


def test_data_without_a_bias_or_biased_twice_fail_every_check(tmp_path):
    job = biased(tmp_path)
    made = files_of_job(job.plate(), job.spec, [])
    for bias_nm in (None, 800, -400, 398):
        path = tmp_path / "other.gds"
        (gdsii,) = products(draw(made.plate, PolygonOptions(hierarchy="merged", bias_nm=bias_nm)), ["gdsii"], ())
        gdsii.write(path)
        failed = {row.name for row in compare_mask(made, read_mask(path), path).quantities() if row.passed is False}
        assert failed >= {"data_xor_area", "data_wrong_parts", "data_width_error", "readback_xor_area"}


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.booleans(), min_size=49, max_size=49).filter(any),
    st.integers(-49, 49).filter(bool).map(lambda half: 160 * half),
    st.sampled_from([0, 8000]),
    st.integers(0, 9),
)
def test_polygons_and_dots_are_sized_alike_whatever_the_opening(dots, bias_nm, gutter_nm, seed):
    """KLayout sizes merged polygons; lines beside those of the dots need none. Kissing corners part, or join."""
    die, plate = drawn_die(np.array(dots).reshape(7, 7), gutter_nm, seed)
    clear = region(plate_layout(plate), CLEAR)
    data = biased_data(clear, plate, bias_nm)
    x, y, parts = biased_raster(die, bias_nm)
    assert np.array_equal(coverage(data, x, y), parts)
    assert data.area() == (np.diff(y) @ parts @ np.diff(x))
    assert (written_of(data, plate, bias_nm) ^ clear).is_empty()


def drawn_die(mask, gutter_nm: int, seed: int):
    """One die of an opening in random orientations, alone on its plate."""
    cells = np.random.default_rng(seed).integers(0, 8, (3, 4), dtype=np.int8)
    panel = Panel(Opening("o", mask, 8000), 8000, gutter_nm, cells, Tiling.RANDOM, 1)
    die = Die("A", "a", panel, (1000, -3000), max(panel.size_nm) + 2)
    return die, Plate("plate", "", 10**8, 10**8, (die,), (), (), ())


def test_a_run_shows_the_plate_as_it_comes_out_and_can_be_verified(tmp_path):
    drawn = with_the_die("TURNED", write_job(tmp_path / "plain", GDSII, opening=BARS))
    plain = run(load_job(drawn), tmp_path / "as drawn")
    job = biased(tmp_path / "biased", export='formats = ["gdsii"]', opening=BARS)
    made = run(job, tmp_path / "out")
    assert all(check.passed is not False for check in verify(tmp_path / "out").checks)
    assert made.passed
    assert made.plate["data_bias"].value == -0.4
    for name in ("stop_open_ratio", "open_ratio"):
        assert made["TURNED"][name].value == pytest.approx(plain["TURNED"][name].value, rel=1e-12)
    assert job.spec.written.cd_bias_um == 0
    # Widths of the file itself are narrower, and one polygon moved by a nanometre is found.
    path = tmp_path / "out" / "SMALL.gds"
    layout = db.Layout()
    layout.read(str(path))
    data = db.Region(layout.top_cell().begin_shapes_rec(layout.find_layer(CLEAR.number, CLEAR.datatype)))
    drawn = region(plate_layout(job.plate()), CLEAR)
    assert data.merged(True, 1).area() < drawn.area()
    assert (data - drawn).is_empty()
    with pytest.raises(JobError, match="MF128"):
        verify_file(path, job)


def test_a_package_and_its_papers_say_that_the_data_are_biased(tmp_path):
    job = biased(tmp_path, 0.4, opening=BARS)
    target, shop = tmp_path / "plate.zip", load_shop("compugraphics")
    made = pack(job, shop, target)
    assert made.path is not None
    assert [check for check in verify_package(target) if check.passed is False] == []
    told = "the data are already biased by -0.4 um per clear width; do not bias"
    with zipfile.ZipFile(target) as archive:
        held = {name.rpartition("/")[2]: archive.read(name) for name in archive.namelist()}
    flat = {name: " ".join(held[name].decode().split()) for name in held if name.endswith(SAID)}
    for name in ("order.txt", "order.html", "order.csv", "certificate.json"):
        assert told in flat[name], name
    assert "already biased by -0.4 um" in flat["plate.svg"]
    assert "already biased by -0.4 um" in flat["manifest.json"]
    (bid,) = compare_shops(job.spec, job.plate(), [shop])
    assert bid.answer == "ask first"
    assert "data biased by -0.4 um" in bid.changes


def test_rules_of_a_house_are_judged_on_the_biased_data(tmp_path):
    """Dots that meet by a corner are 0.4 √2 um apart in the data; bars of 4 um have 3.6."""
    meeting = BARS.replace(".##.##.", ".##....").replace("....##.", "...##..")
    for opening, limit, rule in (
        (BARS, "min_feature_um = 3.7\nmin_space_um = 1", None),
        (BARS.replace("##", "#."), "min_feature_um = 3.7\nmin_space_um = 1", "min_feature"),
        (meeting, "min_space_um = 0.5", None),
        (meeting, "min_space_um = 1", "min_space"),
        (BARS, "grid_nm = [1000]", "drawing"),
    ):
        job = biased(tmp_path, 0.4, *2 * (('"8 um"', '"4 um"'), ("56 um", "28 um")), opening=opening)
        shop = parse_shop(f'title = "House"\nsources = []\n[limits]\n{limit}\n', "house", where="a test")
        (bid,) = compare_shops(job.spec, job.plate(), [shop])
        assert [each.rule for each in bid.refusals] == [rule] * (rule is not None), limit
        assert all(each.cure for each in bid.refusals)
        assert all(each.value == 0 for each in bid.findings if each.rule == "corner_touches")


@pytest.mark.parametrize(
    ("bias_um", "code", "more"),
    [
        (0.0, "MF128", {}),
        (0.201, "MF107", {}),
        (0.2, "MF107", {"export": 'grid = "1 um"'}),
        (8.0, "MF127", {}),
        (-8.2, "MF127", {}),
        (0.4, "MF128", {"export": 'formats = ["gdsii", "png"]'}),
        (0.4, "MF128", {"export": 'formats = ["gdsii", "plate_tiff"]\ndpi = "25400 dpi"'}),
    ],
)
def test_data_that_cannot_be_biased_are_refused_before_work(tmp_path, bias_um, code, more):
    with pytest.raises(JobError, match=code) as refusal:
        run(biased(tmp_path, bias_um, **more), tmp_path / "out")
    assert refusal.value.cure
    assert refusal.value.where
    assert not (tmp_path / "out").exists()


def test_a_bias_is_made_good_by_one_alone(tmp_path):
    house = parse_shop('title = "H"\nsources = []\n[order.default]\nbias = "house"\n', "own", where="a test")
    job = biased(tmp_path)
    for stated, passed in (("data", False), (None, False), ("house", True), ("none", True)):
        order = job.spec.order.model_copy(update={"bias": stated})
        found = check_offers(job.spec.model_copy(update={"order": order}), job.plate(), house)
        assert [each.passed for each in found if each.rule == "order_bias"] == [False] * (not passed)
    plain = load_job(write_job(tmp_path / "plain"))
    (said,) = (each for each in order_of(plain.spec, plain.plate(), house).answers if each.key == "bias")
    assert said.source == "house"
    assert "made good by the house" in said.text
    with pytest.raises(OutputError, match=r"MF421 .*data"):
        parse_shop('title = "H"\nsources = []\n[order.default]\nbias = "data"\n', "own", where="a test")
    film = parse_shop(
        'title = "F"\nsources = []\n[accepts]\nformats = ["plate_tiff"]\ndpi = [25400]\n', "film", where=""
    )
    (bid,) = compare_shops(job.spec, job.plate(), [film])
    assert "biased_format" in {each.rule for each in bid.refusals}
    assert job.spec.model_copy(update={"order": None}).drawn() != job.spec.drawn()
