"""The second opinion: plates as asked for pass however they are drawn, and what was laid out wrongly fails by name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from asked_jobs import GUTTER, JOBS, RANDOM, asked_job
from klayout import db
from small_job import write_job
from sweeps import in_turns, sweep

from maskfab.base import provenance
from maskfab.base.model import CLEAR, Die, Mark
from maskfab.base.work import silent
from maskfab.job.order import OrderSection
from maskfab.job.sections import JobSpec, PlateSection
from maskfab.mask import figures, opening_file, panels
from maskfab.mask import layout as plate_layout
from maskfab.mask.comparison import roundtrip
from maskfab.mask.comparison.files import read_back
from maskfab.mask.houses.adaptation import suited
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.judge.verdict import asked, judged
from maskfab.mask.marks import data_matrix, modules
from maskfab.mask.outlines import fitted_text, outline
from maskfab.runs import pipeline
from maskfab.runs.plate_files import draw_files
from maskfab.runs.verification import verify_file

PLAIN = 'blank = "5 in"\nwritable = "100 mm"'
EVERY = '[export]\nformats = ["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg"]\n'


def opinion(job, plate=None, name="drawn"):
    """The rows on what is drawn of a plate, which comes from the job unless it is given."""
    made = draw_files(job, job.plate() if plate is None else plate)
    return judged(made.figures.layout(), name, made.asked)


def faults(rows):
    return {(row.name, row.die): row.method for row in rows if not row.passed}


@pytest.fixture(scope="module")
def job():
    return asked_job()


@pytest.fixture(scope="module")
def plate(job):
    return job.plate()


@pytest.mark.parametrize("kind", JOBS)
def test_plates_as_asked_for_pass_however_they_are_drawn(kind):
    job = asked_job(**JOBS[kind])
    rows = opinion(job)
    assert faults(rows) == {}
    assert [row.name for row in rows] == ["judged_die"] * len(job.spec.die) + ["judged_marks", "judged_text"]
    assert all(row.limit == 0 for row in rows)


@pytest.mark.parametrize("blank", [PLAIN, 'template = "5in"'])
def test_texts_of_the_title_are_judged(blank, monkeypatch):
    job = asked_job(plate=f'{blank}\nserial = "A-017"')
    assert job.plate().texts == {"serial": "A-017"}
    assert faults(opinion(job)) == {}
    for wrong in ({}, {"serial": "A-011"}):
        monkeypatch.setattr(PlateSection, "texts", wrong)
        assert list(faults(opinion(job))) == [("judged_text", None)]


OF_FILES = {"judged_die", "judged_marks", "judged_text"}


def test_every_layout_file_is_judged(tmp_path):
    job = asked_job(plate=PLAIN, more=f'{EVERY}hierarchy = "merged"\n[order]\ntone = "dark"\nchrome = "down"\n')
    made = draw_files(job, job.plate())
    for product in made.products:
        product.write(tmp_path / product.name)
    rows = [row for row in read_back(made, tmp_path, silent).quantities if row.name in OF_FILES]
    assert {row.method.partition(":")[0] for row in rows} == {product.name for product in made.products}
    assert len(rows) == 7 * 4
    assert all(row.passed for row in rows)


def moved(polygons, x, y):
    return tuple(tuple((px + x, py + y) for px, py in polygon) for polygon in polygons)


def flipped(polygons):
    """In place, left and right exchanged."""
    across = [x for polygon in polygons for x, _ in polygon]
    return tuple(tuple((min(across) + max(across) - x, y) for x, y in reversed(polygon)) for polygon in polygons)


def middle(polygons):
    xs, ys = zip(*(point for polygon in polygons for point in polygon), strict=True)
    return (min(xs) + max(xs)) // 2, (min(ys) + max(ys)) // 2


def with_mark(name, change):
    """A plate whose mark of that name has other polygons; dropped where there are none."""

    def changed(plate):
        assert any(mark.name == name for mark in plate.marks)
        marks = (replace(each, polygons=change(each.polygons)) if each.name == name else each for each in plate.marks)
        return replace(plate, marks=tuple(each for each in marks if each.polygons))

    return changed


def symbol(change):
    """Outlines of the code of the job, its modules changed."""
    (code,) = asked(asked_job().spec).codes
    light = change(modules(code.text))
    corner = (place - len(light) * code.module // 2 for place in code.centre)
    return outline(light, code.module, tuple(corner))


def flipped_modules(light, count):
    changed = light.copy()
    changed[5, 5 : 5 + count] ^= True
    return changed


def further(polygons):
    """A place one line under the title's."""
    return middle(polygons)[0], min(y for polygon in polygons for _, y in polygon) - 840_000


def with_dies(change):
    return lambda plate: replace(plate, dies=tuple(change(*plate.dies)))


def one_cell_turned(die):
    cells = die.panel.orientations.copy()
    cells[3, 4] = (cells[3, 4] + 1) % 8
    return replace(die, panel=replace(die.panel, orientations=cells))


SABOTAGES = {
    "fiducial moved by 1 nm": (
        with_mark("FIDUCIAL_SW", lambda old: moved(old, 1, 0)),
        ("judged_marks", None, "FIDUCIAL_SW lies +1 nm along x and +0 nm along y from its place"),
    ),
    "fiducial moved by 1 um": (
        with_mark("FIDUCIAL_NE", lambda old: moved(old, 0, -1000)),
        ("judged_marks", None, "FIDUCIAL_NE lies +0 nm along x and -1000 nm along y from its place"),
    ),
    "fiducial dropped": (with_mark("FIDUCIAL_NW", lambda old: ()), ("judged_marks", None, "FIDUCIAL_NW is missing")),
    "alignment cross moved by 10 um": (
        with_mark("ALIGN_W", lambda old: moved(old, 10_000, 0)),
        ("judged_marks", None, "ALIGN_W lies +10000 nm along x"),
    ),
    "CD bar moved by 1 nm": (
        with_mark("CD_X_2X", lambda old: moved(old, 1, 0)),
        ("judged_marks", None, "CD_X_2X lies +1 nm along x"),
    ),
    "CD bar 1 nm wider": (
        with_mark(
            "CD_X_1X", lambda old: (*old, *(((x, y), (x, y + 9), (x + 1, y + 9), (x + 1, y)) for x, y in [old[0][1]]))
        ),
        ("judged_marks", None, "CD_X_1X has another shape"),
    ),
    "spoke of the star dropped": (
        with_mark("STAR", lambda old: old[1:]),
        ("judged_marks", None, "STAR has another shape"),
    ),
    "data matrix moved by 5 um": (
        with_mark("JOB_CODE", lambda old: moved(old, 5000, 0)),
        ("judged_text", None, "JOB_CODE has modules off their places"),
    ),
    "data matrix of another job": (
        with_mark("JOB_CODE", lambda old: data_matrix("JOB_CODE", middle(old), "other", 200_000).polygons),
        ("judged_text", None, "JOB_CODE reads 'other', not 'maskfab:"),
    ),
    **{
        f"data matrix with {count} wrong modules": (
            with_mark("JOB_CODE", lambda old, count=count: symbol(lambda light: flipped_modules(light, count))),
            ("judged_text", None, f"JOB_CODE has {count} wrong modules"),
        )
        for count in (1, 3, 7)
    },
    "data matrix mirrored": (
        with_mark("JOB_CODE", lambda old: symbol(lambda light: light[:, ::-1])),
        ("judged_text", None, "JOB_CODE is mirrored"),
    ),
    "data matrix turned": (
        with_mark("JOB_CODE", lambda old: symbol(np.rot90)),
        ("judged_text", None, "JOB_CODE is turned by 90 degrees"),
    ),
    "a further line under the title": (
        with_mark("TITLE", lambda old: (*old, *moved(fitted_text("REV B", 420_000, (0, 0), 10**7), *further(old)))),
        ("judged_marks", None, "TITLE has the text 'REV B' beside its lines"),
    ),
    "dust near the title": (
        with_mark("TITLE", lambda old: (*old, *moved((((0, 0), (0, 9), (9, 9), (9, 0)),), *further(old)))),
        ("judged_marks", None, "TITLE has something beside its lines"),
    ),
    "data matrix dropped": (with_mark("JOB_CODE", lambda old: ()), ("judged_text", None, "JOB_CODE is missing")),
    "parity F mirrored": (with_mark("PARITY", flipped), ("judged_marks", None, "PARITY is mirrored")),
    "label mirrored": (with_mark("LABEL_D1", flipped), ("judged_text", None, "LABEL_D1 reads ")),
    "label moved by 1 nm": (
        with_mark("LABEL_D0", lambda old: moved(old, 0, 1)),
        ("judged_text", None, "LABEL_D0 'D0  DIE 0' is not drawn as letters are, or not at its place"),
    ),
    "label dropped": (with_mark("LABEL_D0", lambda old: ()), ("judged_text", None, "LABEL_D0 'D0  DIE 0' is missing")),
    "labels exchanged": (
        with_mark("LABEL_D0", lambda old: fitted_text("D1  die 1", 420_000, LABEL, 500_000)),
        ("judged_text", None, "LABEL_D0 reads 'D1  DIE 1', not 'D0  DIE 0'"),
    ),
    "title dropped": (
        with_mark("TITLE", lambda old: ()),
        ("judged_text", None, "TITLE 'A SMALL PLATE, (TEST) 100%' is missing"),
    ),
    "names of the map dropped": (
        with_mark("DIE_MAP", lambda old: old[:4]),
        ("judged_text", None, "DIE_MAP 'D0' is missing"),
    ),
    "frame of the map dropped": (
        with_mark("DIE_MAP", lambda old: old[2:]),
        ("judged_marks", None, "DIE_MAP has another shape"),
    ),
    "centres of two dies exchanged": (
        with_dies(lambda one, two: (replace(one, centre_nm=two.centre_nm), replace(two, centre_nm=one.centre_nm))),
        ("judged_die", "D0", "cell 0, 0 from the lower left"),
    ),
    "panels of two dies exchanged": (
        with_dies(lambda one, two: (replace(one, panel=two.panel), replace(two, panel=one.panel))),
        ("judged_die", "D1", ", 0 from the lower left"),
    ),
    "die moved by 1 nm": (
        with_dies(lambda one, two: (one, replace(two, centre_nm=(two.centre_nm[0] + 1, two.centre_nm[1])))),
        ("judged_die", "D1", "cell 0, 0 from the lower left"),
    ),
    "one cell turned": (
        with_dies(lambda one, two: (one_cell_turned(one), two)),
        ("judged_die", "D0", "cell 4, 3 from the lower left"),
    ),
    "a mark too many": (
        lambda plate: replace(
            plate, marks=(*plate.marks, Mark("DUST", "cd", CLEAR, (((0, 0), (0, 1), (1, 1), (1, 0)),)))
        ),
        ("judged_marks", None, "first at (0.000, 0.000) um"),
    ),
}
LABEL = -4_500_500, -250_000 - 600_000


@pytest.mark.parametrize("what", SABOTAGES)
def test_what_is_laid_out_wrongly_fails_by_name(what, job, plate):
    sabotage, (name, die, said) = SABOTAGES[what]
    found = faults(opinion(job, sabotage(plate)))
    assert said in found[name, die]
    assert die or set(found) == {(name, die)}


def mirrored_shapes(panel, cell):
    """Cells drawn as in a mirror."""
    return TRUE_SHAPES(panel, cell ^ 4)


TRUE_SHAPES = figures.unit_shapes


@pytest.mark.parametrize("fault", ["cells mirrored", "dies displaced", "references displaced"])
def test_what_is_drawn_wrongly_fails_though_the_design_agrees(fault, job, plate, monkeypatch, tmp_path):
    if fault == "cells mirrored":
        for module in (figures, plate_layout):
            monkeypatch.setattr(module, "unit_shapes", mirrored_shapes)
    elif fault == "dies displaced":
        true = Die.origin_nm.fget
        monkeypatch.setattr(Die, "origin_nm", property(lambda die: (true(die)[0] + 1, true(die)[1])))
    else:
        true_placed = plate_layout.placed

        def displaced(names, grids):
            layout = true_placed(names, grids)
            cell = layout.cell("D1")
            cell.transform(db.Trans(0, 1))
            return layout

        for module in (figures, plate_layout):
            monkeypatch.setattr(module, "placed", displaced)
    made = draw_files(job, plate)
    assert {row.name for row in judged(plate_layout.plate_layout(plate), "design", made.asked) if not row.passed}
    (product,) = (each for each in made.products if each.name.endswith(".gds"))
    product.write(tmp_path / product.name)
    found = read_back(replace(made, products=(product,)), tmp_path, silent).quantities
    failed = {row.name for row in found if row.passed is False}
    assert "judged_die" in failed
    assert "readback_xor_area" not in failed


@pytest.mark.parametrize(("what", "format_"), sweep(in_turns(("cell", "mark"), ("gds", "oas", "dxf")), 2))
def test_files_are_judged_without_the_comparison_of_polygons(format_, what, job, plate, monkeypatch, tmp_path):
    monkeypatch.setattr(roundtrip, "_xor", lambda *args: db.Region())
    monkeypatch.setattr(roundtrip, "_compare_dots", lambda *args: None)
    made = draw_files(job, plate)
    spoilt = draw_files(job, SABOTAGES["die moved by 1 nm" if what == "cell" else "fiducial moved by 1 nm"][0](plate))
    for product in made.products:
        (drawn,) = (
            each for each in (spoilt if product.name.endswith(format_) else made).products if each.name == product.name
        )
        drawn.write(tmp_path / product.name)
    failed = [row for row in read_back(made, tmp_path, silent).quantities if row.passed is False]
    assert {row.name for row in failed} == {"judged_die" if what == "cell" else "judged_marks"}
    assert {row.method.partition(":")[0] for row in failed} == {
        product.name for product in made.products if product.name.endswith(format_)
    }


@pytest.mark.usefixtures("drawn_in_words")
def test_a_run_rests_on_the_second_opinion(monkeypatch, tmp_path):
    job = asked_job(dies=(RANDOM,), plate=PLAIN, more='[export]\nformats = ["oasis"]\n')
    true = type(job).plate
    monkeypatch.setattr(type(job), "plate", lambda self: with_mark("PARITY", flipped)(true(self)))
    result = pipeline.run(job, tmp_path / "out")
    assert not result.passed
    assert {check.name for check in result.checks if check.passed is False} == {"judged_marks"}
    assert "FAIL" in result.verdicts.lines[0]


def test_files_from_elsewhere_are_not_held_against_a_wrong_plate(job, plate, monkeypatch, tmp_path):
    spoilt = SABOTAGES["parity F mirrored"][0](plate)
    (product,) = (each for each in draw_files(job, spoilt).products if each.name.endswith(".gds"))
    product.write(tmp_path / product.name)
    monkeypatch.setattr(type(job), "plate", lambda self: spoilt)
    found = verify_file(tmp_path / product.name, job).quantities
    assert {row.name for row in found if row.passed is False} == {"judged_marks"}


def test_bars_across_marks_are_no_faults_where_a_house_needs_them(job, plate):
    house = load_shop("mr_nanotec")

    def opinion(plate, holes, house=house):
        drawn = plate_layout.plate_layout(suited(plate, house or load_shop("mr_nanotec"), holes))
        return faults(judged(drawn, "stencils", asked(job.spec, house)))

    assert opinion(plate, "layer") == opinion(plate, "bisect") == {}
    assert set(opinion(plate, "bisect", None)) == {("judged_text", None)}
    for what in ("parity F mirrored", "label dropped", "label mirrored", "fiducial dropped", "die moved by 1 nm"):
        sabotage, (name, die, said) = SABOTAGES[what]
        assert said in opinion(sabotage(plate), "bisect")[name, die]
    for mark, change in {
        "CD_X_5X": lambda old: tuple(tuple((min(x, old[0][2][0] - 900), y) for x, y in each) for each in old),
        "DOSE_1X": lambda old: old[1:],
        "JOB_CODE": lambda old: moved(old, 1, 0),
        "TITLE": lambda old: moved(old, 0, 1),
        "LABEL_D0": lambda old: (*old, ((-4_750_000, -400_000), (-4_750_000, -397_000), (-4_747_000, -397_000))),
    }.items():
        assert opinion(with_mark(mark, change)(plate), "bisect"), mark


def test_tilings_do_not_hang_on_rounding():
    """The judge's repulsion is summed otherwise than the layout's."""
    for seed in range(3):
        job = asked_job(dies=(f'tiling = "blue_noise"\nseed = {seed}\n{GUTTER.splitlines()[-1]}',), size="0.7 mm")
        assert faults(judged(plate_layout.plate_layout(job.plate()), "design", asked(job.spec))) == {}


def test_empty_files_lack_everything(job):
    layout = db.Layout()
    layout.create_cell("TOP")
    layout.layer(db.LayerInfo(1, 0))
    found = faults(judged(layout, "empty", asked(job.spec)))
    assert set(found) == {("judged_die", "D0"), ("judged_die", "D1"), ("judged_marks", None), ("judged_text", None)}
    assert np.all(["is missing" in found[key] for key in (("judged_marks", None), ("judged_text", None))])


FRONT = {
    "parity": (OrderSection, "mirrored", property(lambda order: order.chrome != "down"), "judged_marks", "[order]\n"),
    "tone": (JobSpec, "tone", "dark", "judged_text", ""),
    "sign of the bias": (
        JobSpec, "data_bias_nm", property(lambda spec: -round(spec.process.cd_bias_um * 1000)), "judged_die",
        '[process]\ncd_bias = "0.4 um"\n[order]\nbias = "data"\n',
    ),
    "opening upside down": (
        opening_file, "parse_opening", lambda text, where="": upside_down(PARSE(text, where)), "judged_die", ""
    ),
    "map": (panels, "parse_map", lambda text, where="": shifted(READ_MAP(text, where)), "judged_die", ""),
    "hash": (provenance, "job_hash", lambda data: "0123456789abcdef" * 4, "judged_text", ""),
}  # fmt: skip
PARSE, READ_MAP = opening_file.parse_opening, panels.parse_map


def upside_down(opening):
    return replace(opening, mask=opening.mask[::-1])


def shifted(cells):
    return replace(cells, cells=np.roll(cells.cells, 1, axis=1))


@pytest.mark.parametrize("fault", FRONT)
def test_what_the_front_reads_wrongly_is_told_by_the_jobs_own_files(fault, monkeypatch, tmp_path):
    owner, name, wrong, row, more = FRONT[fault]
    (tmp_path / "m.toml").write_text('name = "m"\nmap = """\n' + 10 * "0123456701\n" + '"""\n')
    mapped = ('tiling = "random"', 'tiling = "map"\nmap = "m.toml"')
    file = write_job(tmp_path, mapped, ("[[die]]", f"{more}\n[[die]]"))
    assert faults(opinion(load_job(file))) == {}
    monkeypatch.setattr(owner, name, wrong)
    assert row in {name for name, _ in faults(opinion(load_job(file)))}
