"""Faults inside what draws the polygons of every format: none may pass, for all files then agree on the wrong plate."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from klayout import db
from small_job import command, write_job
from sweeps import sweep

from maskfab.base.model import CLEAR, Plate, Quantity
from maskfab.base.work import silent
from maskfab.mask import figures
from maskfab.mask.comparison.files import read_back
from maskfab.mask.figures import DieFigures, Figures, moved
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import Job, load_job
from maskfab.mask.package.pack import pack
from maskfab.runs.plate_files import draw_files

TEMPLATE = ('blank = "27 mm"\nwritable = "22 mm"', 'template = "5in"')
"""Of a plate with a data matrix."""
GDSII = ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]')

Break = Callable[[pytest.MonkeyPatch], None]


def mark(name: str, by_nm: int, *, alone: bool = False) -> Break:
    """The writer draws a mark, or the last polygon of it ``alone``, somewhat to the right."""

    def apply(patch: pytest.MonkeyPatch) -> None:
        marks = figures._Drawing._marks

        def broken(self):
            found, done = marks(self)
            assert name in [each.name for each in found]
            return tuple(shifted(each) if each.name == name else each for each in found), done

        def shifted(each):
            still, last = (each.shapes[CLEAR][:-1], each.shapes[CLEAR][-1:]) if alone else ((), each.shapes[CLEAR])
            return replace(each, shapes={CLEAR: (*still, *moved(last, (by_nm, 0)))})

        patch.setattr(figures._Drawing, "_marks", broken)

    return apply


def die(name: str, by_nm: int) -> Break:
    """The writer places a die somewhat too high."""

    def apply(patch: pytest.MonkeyPatch) -> None:
        place = figures._Drawing._die

        def broken(self, number: int) -> DieFigures:
            found = place(self, number)
            x, y = found.origin_nm
            return replace(found, origin_nm=(x, y + by_nm)) if found.name == name else found

        patch.setattr(figures._Drawing, "_die", broken)

    return apply


def failed(rows: tuple[Quantity, ...]) -> dict[str | None, str]:
    """What the XOR says of plate and dies where it fails, by die."""
    return {row.die: row.method for row in rows if row.name == "readback_xor_area" and row.passed is False}


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> tuple[Job, Plate]:
    job = load_job(write_job(tmp_path_factory.mktemp("faults"), TEMPLATE))
    return job, job.plate()


def written(job: Job, plate: Plate, folder: Path, ending: str) -> tuple[Quantity, ...]:
    """Rows of one format, drawn, written and read back as a run does it."""
    made = draw_files(job, plate)
    product = next(each for each in made.products if each.name.endswith(ending))
    product.write(folder / product.name)
    return read_back(replace(made, products=(product,)), folder, silent).quantities


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("by_nm", sweep([1, 5000], 1))
def test_all_that_the_writer_moves_fails_and_is_named(whole, tmp_path, monkeypatch, by_nm):
    """Title, fiducial, label, one cell of the data matrix, one letter, two dies."""
    assert not failed(written(*whole, tmp_path, ".gds"))
    for name in ("TITLE", "FIDUCIAL_SW", "LABEL_TURNED"):
        mark(name, by_nm)(monkeypatch)
    for name in ("JOB_CODE", "STAR_TEXT"):
        mark(name, by_nm, alone=True)(monkeypatch)
    for name in ("PLAIN", "TURNED"):
        die(name, by_nm)(monkeypatch)
    found = failed(written(*whole, tmp_path, ".gds"))
    assert found.keys() == {None, "PLAIN", "TURNED"}
    named = {part.split(":")[0] for part in found[None].split("XOR with the design: ")[1].split("; ")}
    assert named == {"TITLE", "FIDUCIAL_SW", "LABEL_TURNED", "JOB_CODE", "STAR_TEXT", "PLAIN", "TURNED"}


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("ending", [".oas", "_R2010.dxf"])
def test_a_moved_fiducial_fails_in_other_formats(whole, tmp_path, monkeypatch, ending):
    mark("FIDUCIAL_NE", 5000)(monkeypatch)
    assert ": FIDUCIAL_NE: " in failed(written(*whole, tmp_path, ending))[None]


@pytest.mark.usefixtures("read_here")
@pytest.mark.parametrize("hierarchy", ["flat", "merged"])
def test_a_moved_fiducial_fails_without_cells(tmp_path, monkeypatch, hierarchy):
    drawing = ("[plate]", f'[export]\nformats = ["gdsii"]\nhierarchy = "{hierarchy}"\n\n[plate]')
    job = load_job(write_job(tmp_path, drawing))
    plate = job.plate()
    assert not failed(written(job, plate, tmp_path, ".gds"))
    mark("FIDUCIAL_NE", 1)(monkeypatch)
    assert ": FIDUCIAL_NE: " in failed(written(job, plate, tmp_path, ".gds"))[None]


@pytest.mark.usefixtures("read_here")
def test_a_layout_that_is_mirrored_as_a_whole_fails(whole, tmp_path, monkeypatch):
    layout = Figures.layout

    def broken(self) -> db.Layout:
        found = layout(self)
        found.transform(db.Trans.M90)
        return found

    monkeypatch.setattr(Figures, "layout", broken)
    found = failed(written(*whole, tmp_path, ".gds"))
    assert found.keys() == {None, "PLAIN", "TURNED"}
    for name in ("TITLE", "JOB_CODE"):
        assert f"{name}: " in found[None]


@pytest.mark.usefixtures("drawn_in_words", "read_here")
def test_a_run_and_its_verification_fail_with_a_fiducial_moved_by_five_micrometres(capsys, tmp_path, monkeypatch):
    job, out = write_job(tmp_path, GDSII), tmp_path / "out"
    with monkeypatch.context() as patch:
        mark("FIDUCIAL_SE", 5000)(patch)
        answer = command(capsys, "run", job, "--out", out, "--quiet")
        again = command(capsys, "verify", out, "--quiet")
    assert (answer.code, again.code) == (1, 1)
    assert "FIDUCIAL_SE: " in answer.stderr
    assert "FIDUCIAL_SE: " in again.stderr


@pytest.mark.usefixtures("read_here")
def test_a_title_moved_by_the_writer_leaves_no_package(tmp_path, monkeypatch):
    job = load_job(write_job(tmp_path))
    mark("TITLE", 5000)(monkeypatch)
    made = pack(job, load_shop("generic-chrome"), tmp_path / "p.zip")
    assert made.path is None
    assert ": TITLE: " in failed(made.checks)[None]
    assert not list(tmp_path.glob("*.zip"))
