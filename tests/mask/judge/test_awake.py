"""A judge that is awake names every planted fault; one that sees nothing, or loses a row, is told."""

from __future__ import annotations

from dataclasses import replace

import pytest
from asked_jobs import JOBS, asked_job
from klayout import db

from maskfab.base.work import silent
from maskfab.mask.comparison import files as comparison
from maskfab.mask.comparison.files import read_back
from maskfab.mask.judge import awake, headers, verdict
from maskfab.mask.judge.awake import missing, planted
from maskfab.runs.plate_files import draw_files


@pytest.fixture(scope="module")
def made():
    job = asked_job()
    return draw_files(job, job.plate())


@pytest.mark.parametrize("kind", JOBS)
def test_every_planted_fault_is_caught(kind):
    job = asked_job(**JOBS[kind])
    made = draw_files(job, job.plate())
    row = planted(made.figures.layout(), "drawn", made.asked)
    assert row.passed, row.method
    assert row.value == row.limit >= 3


BLIND = {
    "dies": (verdict, "_die_row", lambda row: lambda die, left, name: row(die, left.none(), name), "a cell turned"),
    "marks": (verdict, "_wrong_marks", lambda _: lambda *_: iter(()), "PARITY mirrored"),
    "codes": (verdict, "_miscoded", lambda _: lambda *_: "", "a module of the code flipped"),
    "text": (verdict, "_misread", lambda _: lambda *_: "", "a letter of TITLE blotted"),
    "counting": (awake, "missing", lambda _: lambda *_: (), "a row of the judgement dropped"),
}


@pytest.mark.parametrize("what", BLIND)
def test_a_judge_that_is_blind_to_something_is_told(what, made, monkeypatch):
    owner, name, blinded, fault = BLIND[what]
    monkeypatch.setattr(owner, name, blinded(getattr(owner, name)))
    row = planted(made.figures.layout(), "drawn", made.asked)
    assert not row.passed
    assert f"not caught: {fault}" in row.method.replace("an edge moved by 1 nm, ", "") or fault in row.method


def test_rows_that_lack_are_named(made, monkeypatch, tmp_path):
    for product in made.products:
        product.write(tmp_path / product.name)
    rows = read_back(made, tmp_path, silent).quantities
    name = made.products[1].name
    kept = [row for row in rows if not (row.name == "judged_text" and row.method.startswith(name))]
    assert missing(kept, [name], [die.name for die in made.asked.dies]) == (f"{name}: judged_text",)
    monkeypatch.setattr("maskfab.mask.comparison.files.judged", lambda *_: ())
    (row,) = (row for row in read_back(made, tmp_path, silent).quantities if row.name == "judged_rows")
    assert row.value == len(made.products) * (len(made.asked.dies) + 2)
    assert row.passed is False


@pytest.mark.parametrize("changed", [None, 0, 1])
def test_a_file_of_the_same_polygons_in_the_same_cells_has_the_rows_of_the_first(made, monkeypatch, tmp_path, changed):
    """All else is judged by itself: one that differs, and those beside a first that does."""
    few, asked = replace(made, products=made.products[:2]), []
    for number, product in enumerate(few.products):
        product.write(tmp_path / product.name)
        if number == changed:
            layout = db.Layout()
            layout.read(str(tmp_path / product.name))
            cell = next(cell for cell in layout.each_cell() if not cell.is_top())
            cell.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 5, 5))
            layout.write(str(tmp_path / product.name))
    judge = comparison.judged
    monkeypatch.setattr(comparison, "judged", lambda read, name, plate: asked.append(name) or judge(read, name, plate))
    rows = [row for row in read_back(few, tmp_path, silent).quantities if row.name.startswith("judged_")]
    names = [product.name for product in few.products]
    assert asked == (names[:1] if changed is None else names)
    assert missing(rows, names, [die.name for die in made.asked.dies]) == ()
    others = [row for row in rows if row.method.startswith(f"{names[1]}: as {names[0]}: ")]
    assert len(others) == (len(made.asked.dies) + 2 if changed is None else 0)
    assert all(row.passed for row in rows) == (changed is None)


HEADERS = {
    "user unit": (".gds", b"\x3e\x41\x89\x37\x4b\xc6\xa7\xf0", b"\x3f\x41\x89\x37\x4b\xc6\xa7\xf0", "a user unit of"),
    "grid steps": (".oas", b"1.0\x00\xe8\x07", b"1.0\x00\xe9\x07", "1001 grid steps"),
    "measurement": ("R2010.dxf", b"$MEASUREMENT\n 70\n1\n", b"$MEASUREMENT\n 70\n0\n", "$MEASUREMENT 0, not 1"),
    "extents": ("R12.dxf", b"$EXTMAX\n 10\n63500.0", b"$EXTMAX\n 10\n63400.0", "$EXTMAX at 63.4, 63.5 mm"),
    "inches": ("R2010.dxf", b"$INSUNITS\n 70\n13\n", b"$INSUNITS\n 70\n1\n", "$INSUNITS 1, not 13"),
    "tone": (".gbr", b"Digitized data is clear", b"Digitized data is dark", "says that data are dark"),
    "meaning": (".gbr", b"openings in the chrome", b"chrome in the openings", "says that its shapes are chrome"),
    "job": (".cif", b"job ", b"job 0123456789abcdef job ", "is signed with the job 0123456789abcdef"),
    "mesh": (".stl", b"unit mm", b"unit um", "begins with 'unit um"),
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A file of every kind, by the end of its name."""
    formats = '["gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "stl"]'
    job = asked_job(more=f"[export]\nformats = {formats}\n")
    made, folder = draw_files(job, job.plate()), tmp_path_factory.mktemp("headers")
    for product in made.products:
        product.write(folder / product.name)
    return made, folder


@pytest.mark.parametrize("what", HEADERS)
def test_a_header_that_says_otherwise_is_told(what, written, tmp_path):
    (ending, old, new, said), (made, folder) = HEADERS[what], written
    (path, *_) = (folder / product.name for product in made.products if product.name.endswith(ending))
    right = headers.header_row(path, made.asked.header)
    assert right.passed, right.method
    content = path.read_bytes()
    assert old in content
    changed = tmp_path / path.name
    changed.write_bytes(content.replace(old, new, 1))
    wrong = headers.header_row(changed, made.asked.header)
    assert (wrong.passed, wrong.value) == (False, 1)
    assert said in wrong.method


def test_headers_are_read_of_every_file(written):
    made, folder = written
    rows = [row for row in read_back(made, folder, silent).quantities if row.name == "judged_headers"]
    assert sorted(row.method.partition(":")[0] for row in rows) == sorted(product.name for product in made.products)
    dark = replace(made.asked.header, dark=True)
    assert not headers.header_row(folder / next(p.name for p in made.products if p.name.endswith("gbr")), dark).passed
