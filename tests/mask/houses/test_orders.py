"""What an order changes in the data, what it says on paper, and what it is refused for."""

from __future__ import annotations

import csv
import io
import zipfile
from dataclasses import replace

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from klayout import db
from small_job import command, with_the_die, write_job
from sweeps import sweep

from maskfab.base.errors import JobError
from maskfab.base.model import CHROME, CLEAR, LAYERS, Mark
from maskfab.job.order import OrderSection
from maskfab.job.shop import dump_shop, parse_shop
from maskfab.mask.comparison.files import compare_mask, read_mask
from maskfab.mask.composition import mirrored
from maskfab.mask.figures import CUT, PolygonOptions, draw
from maskfab.mask.houses.adaptation import fitted
from maskfab.mask.houses.files import files_of_job
from maskfab.mask.houses.order import BLANK, check_offers, order_of
from maskfab.mask.houses.profiles import load_shop, shop_names
from maskfab.mask.job import load_job
from maskfab.mask.layout import layer_info, plate_layout, region
from maskfab.mask.package.papers import order_sheet
from maskfab.mask.plate_rules import smallest_of_plate
from maskfab.runs.pipeline import run
from maskfab.runs.stages import measure_process

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

ALL = 'formats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg"]'
FILLED = """
[order]
glass = "quartz"
thickness = "2.3 mm"
film = "low-reflective chrome"
optical_density = 3.0
cd = { tolerance = "0.5 um", mean_to_target = "0.25 um" }
registration = "0.5 um"
defects = { size = "5 um" }
protection = "none"
corner_touches = "stay apart"
corner_width = "2 um"
revision = "B"
purchase_number = "4500012"
quantity = 2
delivery = "within two weeks"

[order.contact]
name = "A. Reader"
organisation = "Institute <b>of</b> Optics"
address = "1 Lens Street, Town"
email = "=cmd@example.org"
telephone = "+49 1"
"""


def ordered(folder, *lines: str, extra: str = ""):
    """A small job with [order]."""
    path = write_job(folder)
    path.write_text(path.read_text() + f"\n[export]\n{ALL}\n\n[order]\n" + "\n".join(lines) + "\n" + extra)
    return load_job(path)


def sheet(job, shop) -> str:
    """The order sheet that a package would hold."""
    plate = fitted(job.plate(), shop, job.spec.tone)
    return order_sheet(order_of(job.spec, plate, shop), draw(plate), shop, ("gdsii",), ()).text()


@pytest.mark.parametrize(
    ("tone", "chrome"), sweep([("clear", "up"), ("dark", "down"), ("clear", "down"), ("dark", "up")], 2)
)
def test_files_of_each_tone_and_parity_hold_the_design_or_its_image_exactly(tmp_path, tone, chrome):
    job = ordered(tmp_path, f'tone = "{tone}"', f'chrome = "{chrome}"')
    plain = replace(job, spec=job.spec.model_copy(update={"order": OrderSection(tone=tone)})).plate()
    made = files_of_job(job.plate(), job.spec, ["made for a test"])
    for product in made.products:
        path = tmp_path / product.name
        product.write(path)
        trip = compare_mask(made, read_mask(path), path)
        assert trip.xor_area_um2 == 0
        assert all(die.wrong_dots == 0 for die in trip.dies)
        assert all(check.passed for check in trip.quantities() if check.passed is not None)
    # And by the polygons alone, without what compares files: mirrored as a whole, and taken out of the writable area.
    layout = db.Layout()
    layout.read(str(tmp_path / "SMALL.gds"))
    data, design = region(layout, CHROME if tone == "dark" else CLEAR), region(plate_layout(plain), CLEAR)
    assert layout.find_layer(layer_info(CLEAR if tone == "dark" else CHROME)) is None
    wanted = design.transformed(db.Trans.M90) if chrome == "down" else design
    half = plain.writable_nm // 2
    whole = db.Region(db.Box(-half, -half, half, half))
    assert (data ^ (whole - wanted if tone == "dark" else wanted)).is_empty()


@pytest.mark.parametrize("holes", ["keyhole", "trapezoids"])
@pytest.mark.parametrize("hierarchy", ["flat", "merged"])
def test_dark_data_are_drawn_in_every_way(tmp_path, holes, hierarchy):
    path = write_job(tmp_path)
    drawing = f'\n[export]\nformats = ["gdsii"]\nholes = "{holes}"\nhierarchy = "{hierarchy}"\n'
    path.write_text(path.read_text() + drawing + '\n[order]\ntone = "dark"\n')
    job = load_job(path)
    made = files_of_job(job.plate(), job.spec, [])
    file = tmp_path / made.products[0].name
    made.products[0].write(file)
    trip = compare_mask(made, read_mask(file), file)
    assert trip.xor_area_um2 == 0
    assert trip.polygons == trip.drawn_polygons


@pytest.mark.parametrize("tone", ["clear", "dark"])
@pytest.mark.parametrize("hierarchy", ["cells", "flat", "merged"])
def test_holes_on_a_layer_of_their_own_take_no_other_figure_with_them(small_plate, tone, hierarchy):
    # A frame round everything on the plate: filled, and its hole subtracted, it would take the plate along.
    (x0, y0, x1, y1), width = (-10_900_000, -10_900_000, 10_900_000, 10_900_000), 50_000
    sides = ((x0, y0, x1, y0 + width), (x0, y1 - width, x1, y1), (x0, y0, x0 + width, y1), (x1 - width, y0, x1, y1))
    frame = Mark("ROUND", "outline", CLEAR, tuple(((a, b), (a, d), (c, d), (c, b)) for a, b, c, d in sides))
    plate = replace(small_plate, marks=(*small_plate.marks, frame))
    drawn = draw(plate, PolygonOptions(tone=tone, holes="layer", hierarchy=hierarchy, notes="none")).layout()
    shown = region(drawn, CHROME if tone == "dark" else CLEAR) - region(drawn, CUT)
    design, half = region(plate_layout(plate), CLEAR), plate.writable_nm // 2
    whole = db.Region(db.Box(-half, -half, half, half))
    assert (shown ^ (whole - design if tone == "dark" else design)).is_empty()


def test_a_plate_mirrored_twice_is_the_plate(tmp_path):
    plate = ordered(tmp_path).plate()
    twice, once = mirrored(mirrored(plate)), plate_layout(mirrored(plate))
    for layer in LAYERS:
        assert (region(plate_layout(plate), layer).transformed(db.Trans.M90) ^ region(once, layer)).is_empty()
    for die, again in zip(plate.dies, twice.dies, strict=True):
        assert die.box_nm == again.box_nm
        np.testing.assert_array_equal(die.panel.orientations, again.panel.orientations)


def test_the_report_is_of_what_the_lens_sees(tmp_path):
    found = {}
    for name, chrome, order in (
        ("plain", "lens", ""),
        ("other", "away", ""),
        ("right", "away", '\n[order]\nchrome = "down"\n'),
    ):
        # So thin that its gap matters to no PSF.
        glass = f'columns = 2\nglass = {{ thickness = "0.001 um", index = 1.5, chrome = "{chrome}" }}'
        path = with_the_die("TURNED", write_job(tmp_path / name, ("columns = 2", glass)))
        path.write_text(path.read_text() + '\n[export]\nformats = ["gdsii", "exr"]\n' + order)
        result = run(path, tmp_path / name / "out")
        assert result.passed
        (psf,) = (tmp_path / name / "out").glob("*TURNED_psf*.exr")
        found[name] = oiio.ImageBuf(str(psf)).get_pixels(oiio.FLOAT)[..., 0], result.plate["lens_view"].value
    np.testing.assert_allclose(found["right"][0], found["plain"][0], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found["other"][0], found["plain"][0][:, ::-1], rtol=1e-6, atol=1e-9)
    assert abs(found["other"][0] - found["plain"][0]).max() > 1e-3 * found["plain"][0].max()
    assert found["right"][1] == "through the glass; the design reads as drawn"
    assert found["other"][1] == "through the glass; the design reads mirrored"


def test_only_what_shows_in_the_data_changes_the_hash_of_a_job(tmp_path):
    plain = ordered(tmp_path / "a")
    assert ordered(tmp_path / "b", 'revision = "C"', "quantity = 3").digest == plain.digest
    assert ordered(tmp_path / "c", 'tone = "dark"').digest != plain.digest
    assert ordered(tmp_path / "d", 'tone = "clear"').digest != ordered(tmp_path / "e", 'chrome = "down"').digest


@pytest.mark.parametrize("name", shop_names())
def test_a_filled_order_has_no_blank_for_any_house(tmp_path, name):
    path = write_job(tmp_path)
    path.write_text(path.read_text() + FILLED)
    job, shop = load_job(path), load_shop(name)
    order = order_of(job.spec, job.plate(), shop, corner_touches=12)
    assert not order.missing
    assert not any(BLANK in each.text for each in order.answers)
    assert {each.source for each in order.answers} <= {"job", "design", "house"}


def test_what_nobody_states_is_blank_and_told(capsys, tmp_path):
    answer = command(
        capsys, "order", "pack", write_job(tmp_path), "--shop", "generic-chrome", "--out", tmp_path / "p.zip", "--quiet"
    )
    assert answer.code == 0
    assert "blank on the order sheet" in answer.stdout
    assert "contact.name" in answer.stdout
    assert "glass" in answer.stdout


def test_corners_that_meet_get_a_width_from_the_job_or_a_proposal_to_choose(tmp_path):
    shop = parse_shop('title = "House"\nsources = []\n[limits]\nmin_feature_um = 3\nmin_space_um = 4\n', "h", where="")
    for fate, shape, least in (("join", "a clear neck", 3), ("stay apart", "a gap of chrome", 4)):
        for width, told in ((None, f"{shape} of {BLANK} um (proposed: {least} um"), ("5 um", f"{shape} of 5 um")):
            said = [f'corner_touches = "{fate}"', *([] if width is None else [f'corner_width = "{width}"'])]
            job = ordered(tmp_path / f"{fate}{width}", *said)
            order = order_of(job.spec, job.plate(), shop, corner_touches=12)
            (answer,) = (each for each in order.answers if each.key == "corner_width")
            assert answer.text.startswith(told)
            assert (answer in order.missing) == (width is None)
    # Narrower than the house writes.
    (found,) = (
        each for each in check_offers(ordered(tmp_path / "fine", 'corner_width = "2 um"').spec, job.plate(), shop)
    )
    assert (found.rule, found.passed) == ("order_corner_width", False)


@pytest.mark.parametrize("chrome", ["up", "down"])
def test_the_sheet_shows_the_letter_that_the_files_hold(tmp_path, chrome):
    job = ordered(tmp_path, f'chrome = "{chrome}"')
    lines = sheet(job, load_shop("compugraphics")).split("\n")
    drawn = lines.index("The letter F on the plate")
    shown = [line[2:7] for line in lines[drawn + 2 : drawn + 7]]
    # The letter of the plate: its stem is the side on which more of it lies.
    (mark,) = (each for each in job.plate().marks if each.kind == "parity")
    letter = db.Region([db.Polygon([db.Point(*point) for point in each]) for each in mark.polygons]).merged()
    box = letter.bbox()
    left, right = (
        (letter & db.Region(db.Box(x0, box.bottom, x1, box.top))).area()
        for x0, x1 in ((box.left, box.center().x), (box.center().x, box.right))
    )
    stem_left = all(row[0] == "#" for row in shown)
    assert stem_left == (left > right)
    assert stem_left != all(row[-1] == "#" for row in shown)
    assert sum("right reading" in line for line in lines) == 1


def test_the_sheet_states_what_is_smallest_of_openings_and_of_marks_apart(tmp_path):
    path = write_job(tmp_path)
    plate = fitted(load_job(path).plate(), load_shop("compugraphics"))
    found = {each.of: each for each in smallest_of_plate(plate)}
    die = found["openings"]
    assert (die.clear_um, die.chrome_um) == (8, 8)
    # As KLayout finds it: nothing is narrower than what is told, and something as narrow is.
    marks = [each for each in plate.marks if each.layer.written and each.kind not in ("resolution", "code")]
    region_of = db.Region([db.Polygon([db.Point(*p) for p in each]) for mark in marks for each in mark.polygons])
    region_of.merge(True, 0)
    region_of.merged_semantics = False
    letters = found["marks and letters"]
    for check, told in ((region_of.width_check, letters.clear_um), (region_of.space_check, letters.chrome_um)):
        least_nm = round(told * 1000)
        assert check(least_nm + 2, False, db.Metrics.Euclidian).count() > 0


def test_papers_say_one_thing_and_prove_it(capsys, tmp_path):
    path = write_job(tmp_path)
    path.write_text(path.read_text() + FILLED.replace("[order]\n", '[order]\ntone = "dark"\nchrome = "down"\n'))
    answer = command(capsys, "order", "pack", path, "--shop", "compugraphics", "--out", tmp_path / "p.zip", "--quiet")
    assert answer.code == 0, answer.stdout
    assert "blank on the order sheet" not in answer.stdout
    assert "By the order they must stay apart" in answer.stdout
    assert "say whether they should join" not in answer.stdout
    with zipfile.ZipFile(tmp_path / "p.zip") as archive:
        held = {name.partition("/")[2]: archive.read(name).decode("latin-1") for name in archive.namelist()}
    for name in ("order.txt", "order.html", "manifest.json", "certificate.json"):
        assert "digitized data dark" in held[name], name
        assert "do not mirror" in held[name], name
    assert "<b>" not in held["order.html"]
    assert "4500012" in held["order.txt"]
    # A spreadsheet takes none of its cells for a formula.
    rows = list(csv.reader(io.StringIO(held["order.csv"])))
    assert ["e-mail", "'=cmd@example.org"] in rows
    assert not any(cell.startswith(("=", "+", "@")) for row in rows for cell in row)
    assert command(capsys, "verify", tmp_path / "p.zip", "--quiet").code == 0


HOUSE = """
title = "House"
sources = []
[offers]
parities = ["right reading"]
glasses = ["soda lime"]
films = ["chrome"]
densities = [2.5, 3.5]
registration_um = 0.3
protections = ["none"]
biased = false
most = 10
[plate]
glass_mm = [1.5, 3.0]
[tolerance]
cd_um = [[10.0, 0.5], [inf, 1.0]]
defect_um = [5.0, 3.0]
"""


@pytest.mark.parametrize(
    ("line", "rule", "extra"),
    [
        ('glass = "quartz"', "order_glass", ""),
        ('film = "low-reflective chrome"', "order_film", ""),
        ('parity = "wrong reading"', "order_parity", ""),
        ('protection = "pellicle"', "order_protection", ""),
        ("quantity = 11", "order_quantity", ""),
        ('thickness = "6 mm"', "order_thickness", ""),
        ("optical_density = 5.0", "order_optical_density", ""),
        ('registration = "0.1 um"', "order_registration", ""),
        ('defects = { size = "1 um" }', "order_defects", ""),
        ('cd = { tolerance = "0.1 um" }', "order_cd", ""),
        ('cd = { feature = "NONE" }', "order_cd_feature", ""),
        ('bias = "house"', "order_bias", '[process]\ncd_bias = "0.1 um"\n'),
    ],
)
def test_what_a_house_does_not_offer_is_refused_with_what_it_does(tmp_path, line, rule, extra):
    job = ordered(tmp_path, line, extra=extra)
    found = check_offers(job.spec, job.plate(), parse_shop(HOUSE, "house", where="a test"))
    refused = [each for each in found if each.passed is False]
    assert [each.rule for each in refused] == [rule]
    assert refused[0].cure
    assert refused[0].limit is not None
    assert all(
        each.passed for each in check_offers(job.spec, job.plate(), load_shop("ualberta_mla150")) if each.rule != rule
    )


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("quantity = 0", "MF104"),
        ('tone = "grey"', "MF105"),
        ('bias = "house"', "MF128"),
        ('purchase_number = "a\\nb"', "MF110"),
        (f'contact = {{ address = "{"x" * 10_000}" }}', "MF110"),
        ('contact = { address = " " }', "MF110"),
        *((f'contact = {{ email = "{said}" }}', "MF105") for said in ("ada", "@b", "a@", "a@b@c", "a b@c", "a@b c")),
        ('contact = { adress = "x" }', "MF102"),
        ('thickness = "2.3"', "MF103"),
        ('date = "soon"', "MF105"),
        ("date = 2026-09-30T10:00:00", "MF105"),
    ],
)
def test_an_order_that_makes_no_sense_is_refused_with_its_key(tmp_path, line, code):
    with pytest.raises(JobError, match=rf"{code} .*order") as refusal:
        ordered(tmp_path, line)
    assert refusal.value.cure


def test_a_parity_that_contradicts_the_side_of_the_chrome_is_refused(tmp_path):
    for chrome, side, refused in (
        ("lens", "up", False),
        ("lens", "down", True),
        ("away", "up", True),
        ("away", "down", False),
    ):
        glass = f'columns = 2\nglass = {{ thickness = "2.3 mm", index = 1.46, chrome = "{chrome}" }}'
        path = write_job(tmp_path / f"{chrome}{side}", ("columns = 2", glass))
        path.write_text(path.read_text() + f'\n[order]\nchrome = "{side}"\n')
        if refused:
            with pytest.raises(JobError, match="MF128"):
                load_job(path)
        else:
            assert load_job(path).spec.order == OrderSection(chrome=side)


def test_a_profile_that_is_dated_says_so_on_the_sheet(tmp_path):
    dated = 'title = "House"\nsources = ["https://example.org/rules"]\nread_on = 2026-09-30\n'
    shop = parse_shop(dated, "house", where="a test")
    assert parse_shop(dump_shop(shop), "house", where="a test") == shop
    said = sheet(load_job(write_job(tmp_path)), shop)
    assert "Rules of the house, read on 2026-09-30\n  https://example.org/rules" in said


@pytest.mark.parametrize(("day", "old"), [("2028-09-29", False), ("2028-10-01", True)])
def test_rules_that_were_read_long_before_the_order_are_told_by_the_day_of_the_order(tmp_path, day, old):
    dated = 'title = "House"\nsources = ["https://example.org/rules"]\nread_on = 2026-09-30\n'
    said = sheet(ordered(tmp_path, f"date = {day}"), parse_shop(dated, "house", where="a test"))
    assert "date of the order" in said
    assert day in said
    assert ("more than two years before this order" in said) is old


def test_a_terminal_is_told_of_rules_that_were_read_long_ago(capsys, tmp_path):
    profile = tmp_path / "old.toml"
    for year, old in ((2019, True), (2999, False)):
        profile.write_text(f'title = "House"\nsources = ["https://example.org/rules"]\nread_on = {year}-01-01\n')
        assert ("two years ago" in command(capsys, "order", "list", profile).stderr) is old


def test_each_revision_has_a_package_of_its_own_and_none_is_overwritten(capsys, tmp_path):
    job = write_job(tmp_path)
    plain = job.read_text()
    job.write_text(plain + '\n[order]\nrevision = "A"\n')
    words = ["order", "pack", job, "--shop", "generic-chrome", "--quiet", "--out"]
    assert command(capsys, *words, tmp_path).code == 0
    first = tmp_path / "SMALL_generic-chrome_revA.zip"
    content = first.read_bytes()
    # Made again it is the same; with anything else in it, it is another revision.
    assert command(capsys, *words, tmp_path, "--force").code == 0
    job.write_text(plain + '\n[order]\nrevision = "A"\nquantity = 2\n')
    changed = command(capsys, *words, tmp_path, "--force")
    assert changed.code == 2
    assert "MF406" in changed.stderr
    assert "order.txt" in changed.stderr
    job.write_text(plain + '\n[order]\nrevision = "B"\n')
    other = command(capsys, *words, first, "--force")
    assert other.code == 2
    assert "MF406" in other.stderr
    assert command(capsys, *words, tmp_path).code == 0
    assert first.read_bytes() == content
    with zipfile.ZipFile(tmp_path / "SMALL_generic-chrome_revB.zip") as archive:
        assert "revision" in archive.read("SMALL_generic-chrome_revB/order.txt").decode()
    assert command(capsys, "verify", tmp_path / "SMALL_generic-chrome_revB.zip", "--quiet").code == 0


def test_a_bias_that_the_house_makes_good_is_not_on_the_plate(tmp_path):
    """The sheet asks for it, and the optics as written are those of edges where they were drawn."""
    seen, told = {}, {}
    for name, line, bias in (
        ("plain", "", 0.0),
        ("written", 'bias = "none"', 0.8),
        ("made good", 'bias = "house"', 0.8),
    ):
        process = f'[process]\ncorner_radius = "0.5 um"\ncd_bias = "{bias} um"\n'
        job = ordered(tmp_path / name, line, extra=process)
        plate = job.plate()
        written = measure_process(job, replace(plate, dies=plate.dies[:1]), lambda *_: None)["PLAIN"]
        seen[name] = {q.name: q.value for q in written.quantities if isinstance(q.value, float)}
        told[name] = next(
            each.text for each in order_of(job.spec, plate, load_shop("pog")).answers if each.key == "bias"
        )
    assert seen["made good"] == seen["plain"] != seen["written"]
    assert told["made good"].startswith("to be made good by the house")
    assert "+0.8 um" in told["written"]
