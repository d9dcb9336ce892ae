"""Panels and plates handed to other libraries hold the same clear area."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import get_args

import pytest
from klayout import db

import maskfab as mf
from maskfab.base.work import silent
from maskfab.job.values import FileFormat
from maskfab.mask.comparison.files import read_back
from maskfab.mask.formats.table import FORMATS
from maskfab.mask.houses.files import PlateFiles
from maskfab.runs.plate_files import draw_files


@pytest.fixture(scope="module")
def panel() -> mf.Panel:
    return mf.Panel.tile(mf.Opening.bar(dots=7, size=(5, 3), pitch="56 um"), size="112 um")


def test_chrome_and_clear_area_make_the_panel_in_every_library(panel: mf.Panel) -> None:
    film_mm = 0.02
    chrome_mm2 = panel.to_trimesh(chrome="20 um").volume / film_mm - 0.112**2 * 2.3 / film_mm
    clear_mm2 = panel.open_ratio * 0.112**2
    assert chrome_mm2 + clear_mm2 == pytest.approx(0.112**2, rel=1e-9)
    solids = [child.obj.val() for child in panel.to_cadquery(chrome="20 um").children if child.name != "GLASS"]
    assert sum(solid.Volume() for solid in solids) / film_mm == pytest.approx(chrome_mm2, rel=1e-9)
    plate = mf.Plate.of(
        P=panel,
        template="5in",
        camera=mf.Camera("5 mm", stop="100 um", pixel="2 um", wavelengths="530 nm", window="64 um"),
    )
    layout = plate.to_klayout()
    clear = db.Region(layout.top_cell().begin_shapes_rec(layout.layer(1, 0)))
    die = plate.layout().dies[0]
    x, y = die.centre_nm
    inside = clear & db.Region(db.Box(x - 56_000, y - 56_000, x + 56_000, y + 56_000))
    assert inside.area() * 1e-12 == pytest.approx(clear_mm2, rel=1e-12)


def test_a_thickness_needs_its_unit(panel: mf.Panel) -> None:
    with pytest.raises(mf.MaskfabError, match="MF103"):
        panel.to_trimesh(chrome="20")


FORMAT_NAMES = get_args(FileFormat)


def _listed(*ends: str) -> str:
    return re.escape(" or ".join([", ".join(ends[:-1]), ends[-1]]))


PLATE_ENDS = sorted({f".{facts.tail.rpartition('.')[2]}" for facts in FORMATS.values() if facts.write_plate})


@pytest.fixture(scope="module")
def everything(panel: mf.Panel) -> tuple[mf.Plate, PlateFiles]:
    """A plate of two dies whose job asks for every format, and its files as a run draws them."""
    plate = mf.Plate.of(
        {"ONE": panel, "TWO": panel},
        blank="27 mm",
        writable="22 mm",
        camera=mf.Camera("5 mm", stop="100 um", pixel="2 um", wavelengths="530 nm", window="64 um"),
        sections={"export": {"formats": list(FORMAT_NAMES), "dpi": "3175 dpi"}},
    )
    job = plate.job()
    return plate, draw_files(job, job.plate())


def test_one_table_holds_every_format_that_a_job_can_name() -> None:
    assert set(FORMATS) == set(FORMAT_NAMES)
    assert {*PLATE_ENDS} >= {".bmp", ".cif", ".dxf", ".gbr", ".gds", ".oas", ".step", ".svg", ".tif"}
    assert [each for each, facts in FORMATS.items() if facts.write_plate is None and facts.write_die is None] == ["exr"]


@pytest.mark.parametrize("format_", [each for each in FORMAT_NAMES if each != "exr"])
def test_python_writes_every_format_as_a_run_does_and_it_is_read_back(everything, tmp_path, format_) -> None:
    """Byte for byte; formats of one die ask for its name."""
    plate, made = everything
    title = FORMATS[format_].title
    products = [
        each for each in made.products if each.form.title == title and (each.die is None or each.die.name == "TWO")
    ]
    assert products
    for product in products:
        product.write(tmp_path / product.name)
        (tmp_path / "python").mkdir(exist_ok=True)
        wrote = plate.write(tmp_path / "python" / product.name, die=product.die and product.die.name)
        assert wrote.read_bytes() == (tmp_path / product.name).read_bytes()
        rows = read_back(replace(made, products=(product,)), wrote.parent, silent).quantities
        assert rows
        assert [row.name for row in rows if row.passed is False] == []


@pytest.mark.parametrize(
    ("name", "die", "told"),
    [
        ("x.dots", None, rf"MF430.*'\.dots'.*Use {_listed(*PLATE_ENDS)}"),
        ("x.glb", None, r"MF430.*\.glb is of one die.*die='OURS'"),
        ("x.exr", "ONE", r"MF430.*PSF.*Run a job"),
        ("x.gds", "ONE", r"MF430.*no die.*\.3mf, \.glb, \.png, \.step, \.stl or \.tif"),
        ("x.glb", "THREE", r"MF105.*'THREE'.*ONE, TWO"),
    ],
)
def test_what_no_file_is_written_for_is_refused_with_what_is(everything, tmp_path, name, die, told) -> None:
    with pytest.raises(mf.MaskfabError, match=told):
        everything[0].write(tmp_path / name, die=die)
    assert not list(tmp_path.iterdir())


def test_dots_of_nobody_knows_what_size_are_refused(everything, tmp_path) -> None:
    with pytest.raises(mf.MaskfabError, match=r"MF105.*export\.dpi"):
        replace(everything[0], sections={}).write(tmp_path / "x.tif")
    assert not list(tmp_path.iterdir())
