"""Verdicts of mask houses: for each of them a plate that it takes, and one that it refuses for the right reason."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from house_plates import DOTS, FINE, FIVE_INCH, SQUARE, checked, opening_for, refusals, taken_as
from small_job import command, listing, write_job

from maskfab.base.model import CLEAR, Plate
from maskfab.job.shop import parse_shop
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.houses import adaptation
from maskfab.mask.houses.adaptation import drawing_options, fitted, written_box
from maskfab.mask.houses.findings import Finding, accepted
from maskfab.mask.houses.profiles import load_shop, shop_names
from maskfab.mask.job import load_job
from maskfab.mask.layout import plate_layout, region

GUTTER = tuple(('pitch = "56 um"', 'pitch = "64 um"\ngutter = "8 um"') for _ in range(2))
REFUSALS = [(name, *refusal) for name in shop_names() for refusal in refusals(load_shop(name))]


def laid_out(folder, edits=(), opening=None) -> Plate:
    named = {} if opening is None else {"opening": opening}
    return load_job(write_job(folder, *edits, **named)).plate()


def judged(plate: Plate, shop, formats) -> tuple[Finding, ...]:
    """The plate in the tone that the house writes."""
    options = replace(drawing_options(fitted(plate, shop), shop), tone=shop.order.tones[0])
    return checked(plate, shop, formats, options)


def broken(findings) -> set[str]:
    return {finding.rule for finding in findings if finding.passed is False}


def the(rule, findings) -> Finding:
    (finding,) = (each for each in findings if each.rule == rule)
    return finding


def test_every_profile_is_tried_both_ways():
    assert {name for name, *_ in REFUSALS} == set(shop_names())


@pytest.mark.parametrize("name", shop_names())
def test_every_shop_takes_a_plate_that_keeps_its_rules(tmp_path, name):
    shop = load_shop(name)
    formats = shop.accepts.formats or shop.accepts.ruled
    findings = judged(laid_out(tmp_path, taken_as(shop), opening_for(shop)), shop, formats)
    assert accepted(findings), [str(each) for each in findings if each.passed is False]


@pytest.mark.parametrize(("name", "rules", "formats", "edits"), REFUSALS, ids=[f"{n}-{r}" for n, r, *_ in REFUSALS])
def test_every_shop_refuses_a_plate_for_the_rule_that_it_breaks(tmp_path, name, rules, formats, edits):
    shop = load_shop(name)
    findings = judged(laid_out(tmp_path, edits, opening_for(shop)), shop, formats)
    assert broken(findings) == set(rules.split())
    for finding in findings:
        if finding.passed is False:
            assert finding.cure
            assert finding.limit is not None
            assert finding.source == " ".join(shop.sources)


def test_values_and_limits_are_those_of_the_plate(tmp_path):
    fine = laid_out(tmp_path, FINE)
    finding = the("min_feature", checked(fine, load_shop("generic-chrome")))
    assert (finding.value, finding.limit, finding.unit) == (0.8, 1.0, "um")
    assert "die" in finding.place
    findings = checked(fine, load_shop("photoplotstore"))
    assert the("min_feature", findings).value == 0.8


def test_between_standard_and_on_request_the_house_is_asked(tmp_path):
    edits = tuple((old, new.replace("0.8", "4").replace("5.6", "28")) for old, new in DOTS)
    finding = the("min_feature", checked(laid_out(tmp_path, edits), load_shop("photoplotstore")))
    assert (finding.passed, finding.value, finding.limit) == (None, 4.0, 6.0)
    assert "request" in finding.cure


def test_kissing_corners_are_neither_a_width_nor_a_space_of_nothing(small_plate):
    findings = checked(small_plate, load_shop("generic-chrome"))
    assert not broken(findings) & {"min_feature", "min_space"}
    touches = the("corner_touches", findings)
    assert touches.passed is None
    assert touches.value > 0


def test_a_house_that_forbids_kissing_corners_refuses_them(small_plate):
    text = 'title = "A"\nsources = []\n[polygons]\ncorner_touches = {}\n[order]\nfields = ["tone"]\n'
    for allowed, passed in (("false", False), ("true", True)):
        shop = parse_shop(text.format(allowed), "mine", where="mine.toml")
        assert the("corner_touches", checked(small_plate, shop)).passed is passed


def test_names_are_judged_as_the_files_will_carry_them(small_plate):
    findings = checked(small_plate, load_shop("ualberta_mla150"))
    assert broken(findings) == {"name"}
    named = [each for each in findings if each.rule == "name" and not each.passed]
    assert [each.value for each in named] == ["small plate"]
    assert accepted(checked(replace(small_plate, name="small"), load_shop("ualberta_mla150")))


def test_a_block_may_not_be_called_as_its_layer(tmp_path):
    edits = (('name = "PLAIN"', 'name = "CLEAR"'),)
    findings = checked(laid_out(tmp_path, edits, SQUARE), load_shop("mr_nanotec"))
    assert broken(findings) == {"block_name"}


def test_only_what_is_written_goes_out_and_the_corners_that_a_house_wants(tmp_path):
    plate = laid_out(tmp_path, FIVE_INCH)
    drawn = fitted(plate, load_shop("gesim"))
    assert all(mark.layer.written for mark in drawn.marks)
    assert drawn.notes == ()
    assert written_box(drawn) == (-50_000_000, -50_000_000, 50_000_000, 50_000_000)
    plain = fitted(plate, load_shop("generic-chrome"))
    assert (region(plate_layout(plain), CLEAR) ^ region(plate_layout(plate), CLEAR)).is_empty()
    squares = region(plate_layout(drawn), CLEAR) - region(plate_layout(plain), CLEAR)
    assert squares.count() == 4
    assert squares.area() == 4 * 50_000**2


@pytest.mark.parametrize(("most", "hierarchy", "paired"), [(300, "cells", 0), (120, "cells", 0), (70, "cells", 1)])
def test_references_are_saved_no_further_than_a_house_needs(tmp_path, most, hierarchy, paired):
    """The random die has 10 x 10 cells, in pairs 50; one die and sixteen marks or so come on top."""
    plate = laid_out(tmp_path)
    text = f'title = "A"\nsources = []\n[limits]\nmax_references = {most}\n[order]\nfields = ["tone"]\n'
    shop = parse_shop(text, "mine", where="mine.toml")
    options = drawing_options(fitted(plate, shop), shop)
    figures = draw(fitted(plate, shop), options)
    assert options.hierarchy == hierarchy
    assert len(figures.account.paired) == paired
    finding = the("references", checked(plate, shop))
    assert finding.passed
    assert finding.value == adaptation.references(figures)


def test_references_beyond_all_help_are_resolved_or_refused(tmp_path):
    plate = laid_out(tmp_path)
    text = 'title = "A"\nsources = []\n[limits]\nmax_references = 30\n[order]\nfields = ["tone"]\n'
    shop = parse_shop(text, "mine", where="mine.toml")
    assert the("references", checked(plate, shop)).value == 0
    finding = the("references", checked(plate, shop, (), PolygonOptions()))
    assert (finding.passed, finding.limit) == (False, 30)
    assert "TURNED" in finding.place
    assert "max_references" in finding.cure


def test_flashes_are_the_rectangles_of_every_cell(tmp_path):
    """A square of three dots is one rectangle; letters and marks are the same on both plates."""
    plate = fitted(laid_out(tmp_path, (), SQUARE), load_shop("pog"))
    bare = replace(plate, dies=())
    for hierarchy in ("cells", "flat", "merged"):
        options = PolygonOptions(hierarchy=hierarchy)
        assert adaptation.flashes(draw(plate, options)) - adaptation.flashes(draw(bare, options)) == 2 * 10 * 10
    # Of the chrome round each square there are four: above, below, and on either side.
    dark = PolygonOptions(tone="dark")
    around = draw(plate, dark)
    assert sum(adaptation.flashes(replace(around, marks=(), dies=(die,))) for die in around.dies) == 4 * 2 * 10 * 10


def test_dots_that_face_each_other_across_cells_are_counted(small_plate):
    """Against the whole raster of the die, one dot at a time."""
    die = small_plate.dies[1]
    panel = die.panel
    whole = np.block([[panel.pattern(cell) for cell in row] for row in panel.orientations.tolist()])
    n = panel.opening.dots
    across = sum(int((whole[:, x - 1] & whole[:, x]).sum()) for x in range(n, whole.shape[1], n))
    along = sum(int((whole[y - 1] & whole[y]).sum()) for y in range(n, whole.shape[0], n))
    assert adaptation.facing_dots(die) == across + along > 0
    assert adaptation.facing_dots(small_plate.dies[0]) == 0


def test_cells_that_share_an_edge_are_those_that_were_cut(tmp_path):
    """Labels have letters with holes: cut through they share an edge, on a layer of their own they do not."""
    plate = laid_out(tmp_path, (), SQUARE)
    assert "LABEL_PLAIN" in adaptation.cut_cells(draw(plate))
    assert "LABEL_PLAIN" not in adaptation.cut_cells(draw(plate, PolygonOptions(holes="layer")))


def test_an_opening_that_reaches_the_next_cell_is_merged_or_given_a_gutter(tmp_path):
    bar = SQUARE.replace("..###..", "#######").replace("square", "bar")
    plate = laid_out(tmp_path, (), bar)
    shop = load_shop("mr_nanotec")
    assert drawing_options(plate, shop).hierarchy == "merged"
    assert the("shared_boundaries", checked(plate, shop, (), PolygonOptions())).passed is False
    gutter = laid_out(tmp_path / "gutter", GUTTER, bar)
    assert the("shared_boundaries", checked(gutter, shop, (), PolygonOptions(holes="layer"))).passed is not False


# --- the command -----------------------------------------------------------------------------------------------------


def test_check_says_pass_and_writes_nothing(capsys, tmp_path):
    job = write_job(tmp_path)
    before = listing(tmp_path)
    answer = command(capsys, "order", "pack", job, "--shop", "generic-chrome", "--dry-run", "--quiet")
    assert answer.code == 0
    assert "PASS min_feature" in answer.stdout
    assert answer.stderr.startswith("PASS")
    assert listing(tmp_path) == before


def test_check_says_what_is_refused_with_rule_source_and_cure(capsys, tmp_path):
    job = write_job(tmp_path)
    answer = command(capsys, "order", "pack", job, "--shop", "gesim", "--dry-run", "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (1, "fail")
    (rule,) = (rule for rule in answer.document["rules"] if rule["passed"] is False)
    assert (rule["rule"], rule["value"], rule["limit"]) == ("blank", 27.0, "127")
    assert rule["source"].startswith("https://gesim")
    assert "plate.blank" in rule["cure"]
    text = command(capsys, "order", "pack", job, "--shop", "gesim", "--dry-run", "--quiet")
    assert text.code == 1
    assert "REFUSED blank: 27 mm" in text.stdout
    assert "gesim" in text.stderr


@pytest.mark.parametrize(
    ("options", "code"), [(("--shop", "nobody"), "MF420"), (("--shop", "gesim", "--format", "stl"), "MF105")]
)
def test_check_refuses_what_it_does_not_know(capsys, tmp_path, options, code):
    answer = command(capsys, "order", "pack", write_job(tmp_path), *options, "--dry-run", "--json", "--quiet")
    assert (answer.code, answer.document["error"]["code"]) == (2, code)
