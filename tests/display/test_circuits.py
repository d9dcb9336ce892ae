"""Drive circuits as boxes of a job: refused, placed or excluded, and the same in every file that is written."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from display.display_jobs import check_refused, job
from jsonschema import Draft202012Validator
from klayout import db
from small_job import OPENING, command, with_the_die
from sweeps import sweep

from maskfab.base.model import CIRCUIT, CLEAR, ORIENTATIONS, Opening, Panel, Tiling, orient
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, of_display
from maskfab.display.circuit_boxes import BoxKind, BoxRules
from maskfab.display.circuits import no_place, place_circuits
from maskfab.display.drive import BOXES_ALONE, BY_BOXES, CircuitRules, LightDemand
from maskfab.display.emitter_rules import EmitterRules, Proof, Verdict
from maskfab.display.feasibility import DisplayRules, Feasibility, display_rules, displays
from maskfab.display.polygon_check import circuit_violations, whole_panel
from maskfab.mask.composition import mirrored_panel
from maskfab.mask.houses.adaptation import fitted
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.report.documents.display import check_schema
from maskfab.report.figures.display import pictures

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

EMITTERS = '\n[emitters]\ncolour_gap = "8 um"\nmin_width = "8 um"\ncircuit = "1 um^2"\n'
BOXES = (
    '[{ name = "transistor", width = "9 um", height = "4 um", count = 3 }, '
    '{ name = "plates", width = "6 um", height = "6 um" }]'
)


def circuits(boxes: str = BOXES, **keys: object) -> str:
    stated = {"gap": '"2 um"', "gap_to_opening": '"1 um"', "per_pixel": 1, **keys}
    return (
        EMITTERS + "\n[circuits]\n" + "".join(f"{key} = {value}\n" for key, value in {"boxes": boxes, **stated}.items())
    )


def found(folder: Path, extra: str, *edits: tuple[str, str], drawing: str = OPENING) -> Feasibility:
    return displays(load_job(job(folder, extra, *edits, drawing=drawing))).displays["TURNED"]


def one(width: str, height: str = "4 um", count: int = 1) -> str:
    return f'[{{ name = "T", width = "{width}", height = "{height}", count = {count} }}]'


REFUSED = {
    "no boxes": (circuits("[]"), "MF105", "circuits.boxes"),
    "box without a name": (circuits('[{ width = "4 um", height = "4 um" }]'), "MF105", "circuits.boxes[0].name"),
    "box without a unit": (circuits(one("4")), "MF103", "circuits.boxes[0].width"),
    "box of nothing": (circuits(one("0 um")), "MF104", "circuits.boxes[0].width"),
    "box larger than the pixel": (circuits(one("57 um")), "MF117", "56 um"),
    "box off the grid": (circuits(one("4.0005 um")), "MF107", "circuits.boxes[0].width"),
    "no box of a kind": (circuits(one("4 um", count=0)), "MF104", "circuits.boxes[0].count"),
    "more boxes than sense": (circuits(one("4 um", count=64), per_pixel=5), "MF115", "320 boxes"),
    "negative gap": (circuits(gap='"-1 um"'), "MF104", "circuits.gap"),
    "gap off the grid": (circuits(gap='"1.0005 um"'), "MF107", "circuits.gap"),
    "gap wider than the pixel": (circuits(gap='"57 um"'), "MF117", "circuits.gap"),
    "negative gap to openings": (circuits(gap_to_opening='"-1 um"'), "MF104", "circuits.gap_to_opening"),
    "gap to openings wider than the pixel": (circuits(gap_to_opening='"57 um"'), "MF117", "circuits.gap_to_opening"),
    "shared by none": (circuits(shared_by=0), "MF104", "circuits.shared_by"),
    "no circuit": (circuits(per_pixel=0), "MF104", "circuits.per_pixel"),
    "another key": (circuits(rotate="true"), "MF102", "circuits.rotate"),
    "circuits without emitters": ("\n[circuits]\nper_pixel = 1\n", "MF105", "[emitters]"),
}  # fmt: skip


@pytest.mark.parametrize(("extra", "code", "said"), REFUSED.values(), ids=REFUSED)
def test_refused_before_anything_is_written(capsys, tmp_path: Path, extra: str, code: str, said: str) -> None:
    check_refused(capsys, tmp_path, extra, code, said)


def test_boxes_are_read_back_from_every_file_and_measured_there(capsys, tmp_path: Path) -> None:
    """On the whole random die, by KLayout, from what it reads: count, sizes, and both gaps."""
    path = with_the_die("TURNED", job(tmp_path, ""))
    path.write_text(path.read_text(encoding="utf-8") + circuits(), encoding="utf-8")
    out = tmp_path / "out"
    answer = command(capsys, "run", path, "--out", out, "--quiet")
    assert answer.code == 0, answer.stderr
    assert BY_BOXES in answer.stderr
    report = json.loads((out / "report.json").read_text(encoding="utf-8"))
    assert {row["value"] for row in report["checks"] if row["name"] == "readback_xor_area"} == {0}
    assert report["verdicts"]["display"]["circuits"] == BY_BOXES
    told = report["dies"][0]["display"]["circuits"]
    assert (told["not_modelled"], told["boxes"]["verdict"], told["boxes"]["wanted"]) == (BOXES_ALONE, "FITS", 4)
    rows = {row["name"]: row for row in report["dies"][0]["quantities"]}
    assert rows["circuit_boxes_placed"]["value"] == len(told["boxes"]["placed"]) == 4
    assert (rows["circuit_rules_broken"]["value"], rows["circuit_rules_broken"]["passed"]) == (0, True)
    for name in ("SMALL.gds", "SMALL.oas", "SMALL_R12.dxf", "SMALL_R2010.dxf"):
        boxes, clear = drawn(out / name, "TURNED")
        assert boxes.count() == 4 * 100, name
        sizes = sorted((shape.bbox().width(), shape.bbox().height()) for shape in boxes.each() if shape.is_box())
        assert {tuple(sorted(size)) for size in sizes} == {(4000, 9000), (6000, 6000)}, name
        assert len(sizes) == 400
        assert boxes.space_check(2000, False, db.Region.Square).count() == 0, name
        assert boxes.separation_check(clear, 1000, False, db.Region.Square).count() == 0, name
        assert (boxes & clear).is_empty()
        # Measured at all: a gap that nobody keeps is broken.
        assert boxes.space_check(30_000, False, db.Region.Square).count() > 0
    assert "boxes of the drive circuits" in (out / "appendix.html").read_text(encoding="utf-8")
    assert command(capsys, "verify", out, "--quiet").code == 0


def drawn(path: Path, die: str) -> tuple[db.Region, db.Region]:
    """Boxes of circuits and openings of a die's cell, in nanometres, as KLayout reads them."""
    layout = db.Layout()
    layout.read(str(path))
    scale = db.ICplxTrans(layout.dbu * 1000)
    by_name = {layout.get_info(index).name: index for index in layout.layer_indexes()}
    regions = []
    for layer in (CIRCUIT, CLEAR):
        index = layout.find_layer(layer.number, layer.datatype)
        index = by_name[layer.name] if index is None else index
        shapes = db.Region(layout.cell(die).begin_shapes_rec(index))
        regions.append(shapes.transformed(scale).merged())
    return regions[0], regions[1]


PROVED = {
    "a box longer than any place": (one("50 um", "9 um"), Proof.CIRCUIT_BOX, "50 x 9 um"),
    "boxes of more than all area": (one("9 um", "6 um", 40), Proof.CIRCUIT_PACKING, "um^2"),
    "boxes that no border leaves room for": (one("6 um", "6 um", 36), Proof.CIRCUIT_PACKING, "36 boxes"),
}


@pytest.mark.parametrize(("boxes", "proof", "said"), sweep(PROVED.values(), 1), ids=PROVED)
def test_circuits_without_a_place_are_a_proof(capsys, tmp_path: Path, boxes: str, proof: Proof, said: str) -> None:
    path = job(tmp_path, circuits(boxes))
    answer = command(capsys, "check", path, "--die", "TURNED", "--json", "--quiet")
    assert (answer.code, answer.document["verdict"]) == (1, "fail")
    Draft202012Validator(check_schema()).validate(answer.document)
    (die,) = answer.document["dies"]
    (told,) = die["display"]["proofs"]
    assert told["proof"] == proof.value
    assert said in told["statement"]
    assert die["display"]["circuits"]["boxes"]["verdict"] == "DOES NOT FIT"
    built = displays(load_job(path))
    shown = pictures(next(d.panel for d in built.plate.dies if d.name == "TURNED"), built.displays["TURNED"])
    assert "display_placement" in shown


def test_an_island_holds_no_circuit(tmp_path: Path) -> None:
    """Nine closed dots within a ring hold a box of three dots, and no line reaches them."""
    rows = ["#######", "##...##", "##...##", "##...##", "#######"]
    closed = f'name = "ring"\npitch = "56 um"\ndots = 7\ngrid = """\n{chr(10).join(rows)}\n#######\n.......\n"""\n'
    reached = closed.replace("##...##\n#######\n#######\n.......", "##...##\n##.####\n##.####\n.......")
    box = circuits(one("20 um", "20 um"), gap_to_opening='"0 um"')
    shut, opened = (found(tmp_path / name, box, drawing=text) for name, text in (("a", closed), ("b", reached)))
    assert shut.circuits.certificate.proof is Proof.CIRCUIT_BOX
    assert (opened.circuits.verdict, len(opened.circuits.boxes)) == (Verdict.FITS, 1)


def test_boxes_decide_and_the_area_is_a_bound(tmp_path: Path) -> None:
    wide = circuits().replace('"1 um^2"', '"9000 um^2"')
    answer = found(tmp_path, wide)
    assert answer.room.certificate is not None
    assert answer.circuits.verdict is Verdict.FITS
    assert Proof.CIRCUIT_AREA not in {proof.proof for proof in answer.certificates}


RULES = BoxRules((BoxKind("T", 9000, 4000, 3), BoxKind("C", 6000, 6000)), 2000, 1000, circuits=1)
MASK = np.zeros((7, 7), dtype=np.bool_)
MASK[1:6, 2:5] = MASK[3, 2:] = True


def panel(mask=MASK, *, gutter_nm: int = 0, cells=None) -> Panel:
    held = np.arange(25).reshape(5, 5) % ORIENTATIONS if cells is None else np.asarray(cells)
    drawn_at = np.random.default_rng(5).permutation(held.ravel()).reshape(held.shape).astype(np.int8)
    return Panel(Opening("x", mask, 8000), 8000, gutter_nm, drawn_at, Tiling.RANDOM, 1)


@pytest.mark.parametrize("gutter_nm", [0, 1000, 8000])
def test_what_is_placed_breaks_no_rule_and_what_is_moved_does(gutter_nm: int) -> None:
    whole = panel(gutter_nm=gutter_nm)
    answer = place_circuits(whole, whole.opening, RULES)
    assert answer.verdict is Verdict.FITS
    assert answer.broken == ()
    first, *others = answer.boxes
    x0, y0, x1, y1 = first.box_nm
    longer = replace(first, box_nm=(x0, y0, x1 - 1, y1))
    told = circuit_violations(replace(whole, circuits=(longer, *others)), RULES)
    assert [each.rule for each in told] == ["size of boxes of circuits"]
    assert told[0].outlines
    near = replace(others[0], box_nm=(x1 + 1999, y0, x1 + 1999 + (x1 - x0), y1))
    rules = {each.rule for each in circuit_violations(replace(whole, circuits=(first, near)), RULES)}
    assert "gap between boxes of circuits" in rules
    middle = replace(first, box_nm=(28_000, 28_000, 28_000 + x1 - x0, 28_000 + y1 - y0))
    rules = {each.rule for each in circuit_violations(replace(whole, circuits=(middle,)), RULES)}
    assert "gap from circuits to openings" in rules
    outside = replace(first, box_nm=(-1, y0, x1 - x0 - 1, y1))
    rules = {each.rule for each in circuit_violations(replace(whole, circuits=(outside,)), RULES)}
    assert "circuit outside its pixel" in rules


def test_neighbours_openings_count_where_the_gap_reaches_over_the_gutter() -> None:
    """An opening along one side keeps boxes off all four where any neighbour may turn it there.

    Of 56 um, 10 are lost at either end of x to its own opening and its neighbour's: 28 are left beside the 8 um of it.
    """
    mask = np.zeros((7, 7), dtype=np.bool_)
    mask[:, 6] = True
    rules = replace(RULES, kinds=(BoxKind("T", 28_000, 28_000),), to_opening_nm=10_000)
    alike, turned = panel(mask, cells=np.zeros((4, 4))), panel(mask)
    assert all(place_circuits(each, each.opening, rules).verdict is Verdict.FITS for each in (alike, turned))
    wide = replace(rules, kinds=(BoxKind("T", 28_000, 50_000),))
    assert place_circuits(alike, alike.opening, wide).verdict is Verdict.FITS
    assert place_circuits(turned, turned.opening, wide).certificate.proof is Proof.CIRCUIT_BOX


def test_the_answer_is_the_same_for_a_turned_opening() -> None:
    for count, fits in ((3, True), (30, False)):
        rules = replace(RULES, kinds=(BoxKind("T", 9000, 4000, count), RULES.kinds[1]))
        answers = {
            (answer.verdict, answer.certificate and answer.certificate.statement)
            for element in (0, 1, 6)
            if (whole := panel(np.ascontiguousarray(orient(MASK, element))))
            and (answer := place_circuits(whole, whole.opening, rules))
        }
        assert len(answers) == 1
        assert (answers.pop()[0] is Verdict.FITS) == fits


def test_boxes_are_mirrored_with_their_pixels_and_left_out_of_what_a_house_gets(tmp_path: Path) -> None:
    plate = displays(load_job(job(tmp_path, circuits()))).plate
    whole = next(die.panel for die in plate.dies if die.name == "TURNED")
    across = db.Trans(db.Trans.M90, whole.size_nm[0], 0)
    there, back = (
        whole_panel(each, (CIRCUIT,))[CIRCUIT].transformed(turned)
        for each, turned in ((whole, across), (mirrored_panel(whole), db.Trans()))
    )
    assert there.count() == 400
    assert (there ^ back).is_empty()
    sent = fitted(plate, load_shop("compugraphics"))
    assert all(die.panel.circuits == () for die in sent.dies)


def test_odd_lengths_are_placed_on_a_coarser_grid_and_keep_their_gaps() -> None:
    rules = BoxRules((BoxKind("T", 9001, 4003, 3), BoxKind("C", 6007, 6007)), 2011, 1013, circuits=1)
    whole = panel(gutter_nm=2)
    answer = place_circuits(whole, whole.opening, rules)
    assert (answer.verdict, answer.broken) == (Verdict.FITS, ())
    assert 56_000 / answer.cell_nm <= 512
    assert {tuple(sorted((box.box_nm[2] - box.box_nm[0], box.box_nm[3] - box.box_nm[1]))) for box in answer.boxes} == {
        (4003, 9001), (6007, 6007)
    }  # fmt: skip
    # What fits exactly is never excluded by a rounded grid.
    strip = np.zeros((7, 7), dtype=np.bool_)
    strip[:, :3] = True
    bare = panel(strip, cells=np.zeros((4, 4)))
    tight = BoxRules((BoxKind("T", 32_000 - 2 * 1013, 7001),), 0, 1013, turnable=False, circuits=1)
    assert no_place(bare, bare.opening, tight) is None
    assert no_place(bare, bare.opening, replace(tight, kinds=(BoxKind("T", 31_990, 7001),))) is not None


def test_pixels_that_share_circuits_hold_fewer() -> None:
    three = replace(RULES, circuits=3)
    assert [(replace(three, shared_by=many).held, replace(three, shared_by=many).boxes) for many in (1, 2, 3, 4)] == [
        (3, 12), (2, 8), (1, 4), (1, 4)
    ]  # fmt: skip
    answer = place_circuits(panel(), panel().opening, replace(three, shared_by=2))
    assert sorted(box.circuit for box in answer.boxes) == [1] * 4 + [2] * 4


def test_a_design_that_must_fit_is_held_to_its_boxes() -> None:
    """By the rule of circuits, whose bound costs little, and by that of emitters, which asks for the places."""
    emitters, area = EmitterRules(0, 8000, 8000), CircuitRules(need_um2=1.0, min_width_nm=8000)
    loose, tight = (
        DisplayRules(emitters, 1.0, area, LightDemand(), None, replace(RULES, kinds=(BoxKind("T", 9000, 4000, many),)))
        for many in (3, 60)
    )
    for rules, fits in ((loose, True), (tight, False)):
        asked = Display.of(rules, Tiling.RANDOM, 0, 4, 4)
        held = Constraints(int(MASK.sum()), dots=7, dot_nm=8000, **of_display(asked))
        assert held.allows(MASK) == fits
        assert (not held.violations(MASK)) == fits
        assert (asked.broken_on(asked.panel(MASK, 8000)) is None) == fits
    assert tight.least_circuits_um2 == 60 * 36


def test_jobs_without_the_section_are_as_they_were(tmp_path: Path) -> None:
    path = job(tmp_path, EMITTERS)
    built = displays(load_job(path))
    assert display_rules(load_job(path)).boxes is None
    assert all(answer.circuits is None for answer in built.displays.values())
    assert all(die.panel.circuits == () for die in built.plate.dies)


def test_the_default_boxes_are_those_of_a_circuit_on_sale(tmp_path: Path) -> None:
    """With gaps they and two lines of 3 um along 63 um take no more than the subpixel of 63 x 31.5 um."""
    rules = display_rules(load_job(job(tmp_path, EMITTERS + "\n[circuits]\n"))).boxes
    assert sum(kind.count for kind in rules.kinds) == 8
    with_gaps = sum(
        kind.count * (kind.width_nm + rules.gap_nm) * (kind.height_nm + rules.gap_nm) for kind in rules.kinds
    )
    assert with_gaps / 1e6 == 1576
    assert with_gaps / 1e6 + 2 * 3 * 63 <= 63 * 31.5
