"""The files of a plate read back: what was written passes in every format, what was not fails in every format."""

from __future__ import annotations

import multiprocessing
import shutil
import time
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from hostile_files import overlapping
from klayout import db
from PIL import Image
from small_job import JOB
from sweeps import sweep

from maskfab.base.errors import InputError, SourceError
from maskfab.base.model import CLEAR, Plate, Quantity
from maskfab.base.work import silent
from maskfab.job.read import validate
from maskfab.job.sections import JobSpec
from maskfab.mask import layout as shape_limits
from maskfab.mask import sandbox
from maskfab.mask.comparison import files
from maskfab.mask.comparison.files import read_back
from maskfab.mask.formats.format import Product
from maskfab.mask.houses.files import PlateFiles, files_of_job
from maskfab.mask.layout import layer_info, region
from maskfab.mask.process_limits import children_seconds

pytestmark = pytest.mark.usefixtures("read_here")

MASKS = ("gdsii", "oasis", "dxf_r12", "dxf_r2010", "gerber", "cif", "svg")
SOLIDS = ("step", "glb", "3mf", "stl")
PICTURES = ("png", "tiff")
MASK_ENDINGS = (".gds", ".oas", "_R12.dxf", "_R2010.dxf", ".gbr", ".cif", ".svg")
DIE_ENDINGS = (".step", ".glb", ".3mf", ".stl", ".png", ".tif")


def spec(text: str = "") -> JobSpec:
    # Four micrometres are half a dot: pixels follow the dots and gutters of the first and the last die.
    formats = ", ".join(f'"{each}"' for each in (*MASKS, *SOLIDS, *PICTURES))
    return validate(tomllib.loads(f"{JOB}\n[export]\nformats = [{formats}]\ndots_per_um = 0.25\n{text}"), where="job")


@pytest.fixture(scope="module")
def made(small_plate) -> PlateFiles:
    return files_of_job(small_plate, spec(), ["job 0123abcd"])


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory) -> Path:
    """Every file of the plate; tests copy what they damage."""
    place = tmp_path_factory.mktemp("files")
    for product in made.products:
        product.write(place / product.name)
    return place


def only(made: PlateFiles, product: Product) -> PlateFiles:
    return replace(made, products=(product,))


def named(made: PlateFiles, ending: str) -> Product:
    (found,) = (product for product in made.products if product.name.endswith(ending))
    return found


def failed(made: PlateFiles, product: Product, place: Path) -> set[str]:
    rows = read_back(only(made, product), place, silent).quantities
    assert all(product.name in row.method for row in rows if row.passed is False)
    return {row.name for row in rows if row.passed is False}


def without_a_dot(plate: Plate) -> Plate:
    """The plate with one clear dot of the first die's opening closed."""
    first, *others = plate.dies
    mask = first.panel.opening.mask.copy()
    mask[1, 1] = False
    opening = replace(first.panel.opening, mask=mask)
    return replace(plate, dies=(replace(first, panel=replace(first.panel, opening=opening)), *others))


# --- what was written passes -----------------------------------------------------------------------------------------


def test_every_format_of_a_plate_comes_back_as_it_was_drawn(made, folder):
    """STEP of one die for all: a library of solids is started for each of its files."""
    others = tuple(each for each in made.products if not each.name.endswith(("DENSE.step", "RANDOM.step")))
    made = replace(made, products=others)
    told: list[tuple[str, int, int]] = []
    back = read_back(made, folder, lambda *step: told.append(step))
    judged = [row for row in back.quantities if row.passed is not None]
    assert [str(row) for row in judged if not row.passed] == []
    assert told == [("read back", n, len(made.products)) for n in range(len(made.products) + 1)]
    # Every file is judged by a row that names it, and a file about a die by rows of that die.
    for product in made.products:
        rows = [row for row in judged if product.name in row.method]
        assert rows, product.name
        if product.die is not None:
            assert {row.die for row in rows} == {product.die.name}
    assert [trip.path.name for trip in back.trips] == [each.name for each in made.products if each.polygons]


def test_the_first_layout_alone_is_compared_dot_by_dot(made, folder):
    trips = read_back(replace(made, products=made.products[:3]), folder, silent).trips
    assert [all(die.wrong_dots == 0 for die in trip.dies) for trip in trips] == [True, False, False]
    assert {die.wrong_dots for trip in trips[1:] for die in trip.dies} == {None}


def test_the_first_layout_alone_is_kept(made, folder):
    first, *others = (
        trip.layout for trip in read_back(replace(made, products=made.products[:3]), folder, silent).trips
    )
    assert first.top_cell().name
    assert [layout.cells() for layout in others] == [0, 0]


def test_a_die_has_a_file_of_each_solid_and_picture_and_the_plate_one_of_each_layout(made, small_plate):
    assert len(made.products) == len(MASKS) + 3 * len(SOLIDS + PICTURES) + 1
    assert len({product.name for product in made.products}) == len(made.products)
    for ending in (*MASK_ENDINGS, *DIE_ENDINGS):
        assert any(product.name.endswith(ending) for product in made.products), ending
    kinds = [(product.form.name, None if product.die is None else product.die.name) for product in made.products]
    assert kinds.count(("step", None)) == 1
    for die in small_plate.dies:
        assert sorted(name for name, of in kinds if of == die.name) == sorted((*SOLIDS, *PICTURES))


def test_a_job_without_export_becomes_four_layouts(small_plate):
    names = [
        product.name for product in files_of_job(small_plate, validate(tomllib.loads(JOB), where="job"), []).products
    ]
    assert names == [f"{small_plate.name}{tail}" for tail in (".gds", ".oas", "_R12.dxf", "_R2010.dxf")]


def test_what_was_done_to_draw_polygons_is_told(made):
    counts = {row.name: row.value for row in made.account()}
    assert counts.keys() == {"drawn_holes", "drawn_parted", "drawn_split"}
    assert counts["drawn_holes"] > 0  # the ring, and B, 8 and 0 of the title
    assert counts["drawn_split"] == 0
    assert all(row.passed is None for row in made.account())


def test_settings_of_the_job_reach_the_files(small_plate):
    settings = files_of_job(
        small_plate, spec('stl_limit_mb = 0.5\nchrome = "80 nm"\nexaggeration = 20\nmax_vertices = 200'), []
    ).settings
    assert settings.stl_limit_bytes == 500_000
    assert (settings.stack.chrome_nm, settings.stack.exaggeration) == (pytest.approx(80), 20)
    assert settings.dots_per_um == 0.25


def test_an_stl_above_its_limit_is_refused(small_plate, tmp_path):
    product = named(files_of_job(small_plate, spec("stl_limit_mb = 0.001"), []), "PERIODIC.stl")
    with pytest.raises(InputError, match=r"MF411.*export\.stl_limit_mb"):
        product.write(tmp_path / "x.stl")
    assert not list(tmp_path.iterdir())


# --- what was not drawn fails ----------------------------------------------------------------------------------------


def test_a_closed_dot_fails_in_every_format(made, small_plate, tmp_path):
    """All 20 cells of the first die differ by one dot of 8 um."""
    other = files_of_job(without_a_dot(small_plate), spec(), ["job 0123abcd"])
    for product, wrong in zip(made.products, other.products, strict=True):
        assert product.name == wrong.name
        if (product.form.name == "step" and product.die is None) or (
            product.die is not None and product.die.name != "PERIODIC"
        ):
            continue
        wrong.write(tmp_path / product.name)
        assert failed(made, product, tmp_path), product.name


def test_a_moved_die_fails_in_the_plate_step(made, small_plate, tmp_path):
    first, *others = small_plate.dies
    x, y = first.centre_nm
    moved = replace(small_plate, dies=(replace(first, centre_nm=(x + 2, y)), *others))
    product = next(each for each in made.products if each.form.name == "step" and each.die is None)
    named(files_of_job(moved, spec(), []), product.name).write(tmp_path / product.name)
    assert failed(made, product, tmp_path) == {"solid_position_error"}


@pytest.mark.parametrize("ending", sweep((".glb", ".tif", ".step", ".3mf", ".stl", ".png"), 2))
def test_files_of_two_dies_that_are_swapped_fail_both(made, folder, tmp_path, ending):
    """Dies of one opening and one size that differ by their orientations."""
    pair = [named(made, f"{name}{ending}") for name in ("PERIODIC", "RANDOM")]
    for one, other in (pair, pair[::-1]):
        shutil.copy(folder / other.name, tmp_path / one.name)
        found = failed(made, one, tmp_path)
        assert found >= ({"bitmap_xor_area"} if one.form.name in PICTURES else {"solid_wrong_cells"})


def test_a_polygon_of_the_svg_that_moved_fails(made, folder, tmp_path):
    product = named(made, ".svg")
    text = (folder / product.name).read_text(encoding="utf-8")
    start = text.index('x="', text.index("<use"))
    end = text.index('"', start + 3)
    moved = f'x="{float(text[start + 3 : end]) + 0.001:.6f}'
    (tmp_path / product.name).write_text(text[:start] + moved + text[end:], encoding="utf-8")
    assert "readback_xor_area" in failed(made, product, tmp_path)


@pytest.mark.parametrize("ending", [".gds", ".oas"])
def test_a_polygon_of_a_layout_that_moved_by_a_nanometre_fails(made, folder, tmp_path, ending):
    product, layout = named(made, ending), db.Layout()
    layout.read(str(folder / product.name))
    cell = layout.cell("PERIODIC")
    cell.flatten(True)
    next(cell.shapes(layout.layer(layer_info(CLEAR))).each()).transform(db.Trans(1, 0))
    layout.write(str(tmp_path / product.name))
    assert "readback_xor_area" in failed(made, product, tmp_path)


@pytest.mark.parametrize("ending", ["PERIODIC.png", "RANDOM.tif"])
def test_one_wrong_pixel_fails(made, folder, tmp_path, ending):
    product = named(made, ending)
    with Image.open(folder / product.name) as image:
        value = image.getpixel((7, 5))
        image.putpixel((7, 5), 0 if value else 255)
        image.save(tmp_path / product.name, dpi=image.info["dpi"])
    wrong, area = read_back(only(made, product), tmp_path, silent).quantities
    assert (wrong.passed, wrong.value, wrong.limit) == (False, 1, 0)
    assert (area.passed, area.value, area.limit) == (False, pytest.approx(16), 0)


# --- what cannot be read ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [b"", b"no such thing", None], ids=["empty", "other", "missing"])
def test_what_cannot_be_read_is_refused_and_told_by_its_name(made, tmp_path, content):
    products = [named(made, ending) for ending in (*MASK_ENDINGS, *(f"DENSE{each}" for each in DIE_ENDINGS))]
    products.append(next(each for each in made.products if each.form.name == "step" and each.die is None))
    for product in products:
        if content is not None:
            (tmp_path / product.name).write_bytes(content)
    with pytest.raises(SourceError):
        read_back(only(made, products[0]), tmp_path, silent)
    refused: list[tuple[str, InputError]] = []
    back = read_back(replace(made, products=tuple(products)), tmp_path, silent, refused)
    assert (back.trips, back.quantities) == ((), ())
    assert [name for name, _ in refused] == [product.name for product in products]


def test_the_others_are_read_where_one_cannot_be(made, folder, tmp_path):
    """The next layout is then the one that is compared dot by dot."""
    chosen = [named(made, ending) for ending in (".gds", ".oas", "DENSE.png")]
    for product in chosen[1:]:
        shutil.copy(folder / product.name, tmp_path / product.name)
    refused: list[tuple[str, InputError]] = []
    back = read_back(replace(made, products=tuple(chosen)), tmp_path, silent, refused)
    assert [name for name, _ in refused] == [chosen[0].name]
    (trip,) = back.trips
    assert [die.wrong_dots for die in trip.dies] == [0, 0, 0]
    assert "bitmap_xor_area" in {row.name for row in back.quantities}
    assert all(isinstance(row, Quantity) and row.passed is not False for row in back.quantities)


@pytest.mark.slow
def test_files_that_are_read_beside_the_others_are_told_in_their_places(made, folder, tmp_path):
    """Gerber and STEP, damaged or whole, come where they stand among the files, and their rows with them."""
    chosen = [named(made, end) for end in (".gds", ".gbr", ".oas", "RANDOM.step", "DENSE.step", "DENSE.glb")]
    for product in chosen:
        shutil.copy(folder / product.name, tmp_path / product.name)
    (tmp_path / chosen[3].name).write_text("no such thing", encoding="utf-8")
    refused: list[tuple[str, InputError]] = []
    back = read_back(replace(made, products=tuple(chosen)), tmp_path, silent, refused)
    assert [(name, error.code) for name, error in refused] == [(chosen[3].name, "MF303")]
    assert [trip.path.name for trip in back.trips] == [product.name for product in chosen[:3]]
    told = [next(n for n, product in enumerate(chosen) if product.name in row.method) for row in back.quantities]
    assert set(told) == {0, 1, 2, 4, 5}
    assert told == sorted(told)
    with pytest.raises(SourceError, match=chosen[3].name):
        read_back(replace(made, products=tuple(chosen)), tmp_path, silent)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="limits are those of a copy")
@pytest.mark.usefixtures("within_limits")
def test_a_layout_that_anybody_wrote_is_compared_within_limits(made, tmp_path, monkeypatch):
    monkeypatch.setattr(sandbox, "SECONDS", 0)  # for so few bytes one is added
    monkeypatch.setattr(shape_limits, "MOST_COVERED", 1e9)  # or it is refused at once
    product = named(made, ".oas")
    overlapping(tmp_path / product.name, 2000)
    refused: list[tuple[str, InputError]] = []
    before = children_seconds() + time.process_time()
    back = read_back(only(made, product), tmp_path, silent, refused)
    assert [(name, error.code) for name, error in refused] == [(product.name, "MF322")]
    assert (back.trips, back.quantities) == ((), ())
    assert children_seconds() + time.process_time() - before < 6


def test_a_layout_of_far_more_vertices_than_the_plate_is_not_looked_through(made, folder, tmp_path):
    product = named(made, ".gds")
    layout = db.Layout()
    layout.read(str(folder / product.name))
    top, more = layout.top_cell(), layout.create_cell("MORE")
    more.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 100, 100))
    at = db.Trans(top.bbox().right, 0)
    top.insert(db.CellInstArray(more.cell_index(), at, db.Vector(200, 0), db.Vector(0, 200), 200, 200))
    layout.write(str(tmp_path / product.name))
    refused: list[tuple[str, InputError]] = []
    read_back(only(made, product), tmp_path, silent, refused)
    assert [(name, error.code) for name, error in refused] == [(product.name, "MF313")]
    assert "vertices" in str(refused[0][1])


def test_a_layout_that_anybody_wrote_is_what_its_optics_see(made, folder, tmp_path):
    """Equal to the design it is the design; with a dot more it has that dot."""
    product = named(made, ".gds")
    shutil.copy(folder / product.name, tmp_path)
    (trip,) = read_back(only(made, product), tmp_path, silent, []).trips
    assert trip.layout is made.design
    layout = db.Layout()
    layout.read(str(folder / product.name))
    dot = layout.top_cell().bbox().enlarged(100, 100)
    dot = db.Box(dot.left, dot.bottom, dot.left + 40, dot.bottom + 40)
    layout.top_cell().shapes(layout.layer(1, 0)).insert(dot)
    layout.write(str(tmp_path / product.name))
    (trip,) = read_back(only(made, product), tmp_path, silent, []).trips
    (differing,) = (region(trip.layout, CLEAR) ^ region(made.design, CLEAR)).each()
    assert differing == db.Polygon(dot)
    assert trip.xor_area_um2 == pytest.approx(1600e-6)


def test_what_klayout_throws_at_a_file_is_told_of_the_file(made, folder, monkeypatch):
    def thrown(*_, **__):
        raise RuntimeError("Internal error: m_open.empty () was not true")

    monkeypatch.setattr(files, "compare_layout", thrown)
    refused: list[tuple[str, InputError]] = []
    read_back(only(made, made.products[0]), folder, silent, refused)
    assert [(name, error.code) for name, error in refused] == [(made.products[0].name, "MF323")]
