"""The referee that travels in packages: it needs nothing, takes plates that are right, and finds what is not."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from klayout import db

from maskfab.base import resources
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job
from maskfab.mask.package.pack import pack

LAYOUTS = Path(__file__).parents[3] / "layouts"


def packed(layout, folder):
    made = pack(load_job(LAYOUTS / f"{layout}.toml"), load_shop("generic-chrome"), folder / f"{layout}.zip", ("gdsii",))
    assert made.path is not None, made
    return made.path


@pytest.fixture(scope="module")
def referee():
    spec = importlib.util.spec_from_file_location("referee", resources.path("export_templates/referee.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module", params=["order_chrome", "order_through_glass"])
def package(request, tmp_path_factory):
    return packed(request.param, tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def plate(package, tmp_path_factory):
    """The package unpacked, and the name of its GDSII."""
    folder = tmp_path_factory.mktemp("unpacked")
    with zipfile.ZipFile(package) as archive:
        for name in archive.namelist():
            (folder / name.rpartition("/")[2]).write_bytes(archive.read(name))
    return folder, next(folder.glob("*.gds"))


def judged(referee, plate, data, job=None):
    folder, _ = plate
    template = referee.toml((folder / "template.toml").read_text())
    version = json.loads((folder / "manifest.json").read_text())["maskfab_version"]
    job = json.loads((folder / "job.json").read_text()) if job is None else job
    return referee.judge(job, template, version, data)[0].wrong


def test_a_package_proves_itself_to_bare_python(package):
    with zipfile.ZipFile(package) as archive:
        names = {name.rpartition("/")[2] for name in archive.namelist()}
    assert {"referee.py", "template.toml", "job.json"} <= names
    script = str(resources.path("export_templates/referee.py"))
    told = subprocess.run(
        [sys.executable, "-I", "-S", script, str(package)], capture_output=True, text=True, check=False, timeout=60
    )
    assert told.returncode == 0, told.stdout + told.stderr
    assert "this plate is what this text asks for" in told.stdout


def changed(plate, tmp_path, change, unit=0.001):
    """The GDSII with something changed, as bytes."""
    layout = db.Layout()
    layout.read(str(plate[1]))
    layer = next(index for index in layout.layer_indexes() if layout.get_info(index).layer in (1, 3))
    change(layout, layer)
    layout.dbu = unit
    options = db.SaveLayoutOptions()
    options.format, options.dbu = "GDS2", unit
    layout.write(str(tmp_path / "changed.gds"), options)
    return (tmp_path / "changed.gds").read_bytes()


def die_of(layout):
    return max(layout.each_cell(), key=lambda cell: cell.child_instances())


def turned(layout, layer):
    die = die_of(layout)
    instance = next(each for each in die.each_inst())
    box = instance.bbox()
    instance.transform(db.Trans(1, False, 0, 0))
    instance.transform(db.Trans(box.left - instance.bbox().left, box.bottom - instance.bbox().bottom))


def nudged(layout, layer):
    next(each for each in die_of(layout).each_inst()).transform(db.Trans(1, 0))


def exchanged(layout, layer):
    top = layout.top_cell()
    one, other = [
        each for each in top.each_inst() if each.cell.name.startswith("BAR_") and each.cell.child_instances()
    ][:2]
    one.cell, other.cell = other.cell, one.cell


def missing(layout, layer):
    for cell in layout.each_cell():
        if cell.name.startswith("LABEL"):
            next(iter(cell.each_shape(layer))).delete()
            return
    raise AssertionError("no label")


def stray(layout, layer):
    layout.top_cell().shapes(layer).insert(db.Box(3_000_000, 30_000_000, 3_000_010, 30_000_001))


def mirrored_mark(name):
    def change(layout, layer):
        for instance in layout.top_cell().each_inst():
            if instance.cell.name == name:
                x = instance.bbox().center().x
                instance.transform(db.Trans(db.Trans.M90, 2 * x, 0))

    return change


def turned_mark(name, quarters=1):
    def change(layout, layer):
        for instance in layout.top_cell().each_inst():
            if instance.cell.name == name:
                middle = instance.bbox().center()
                instance.transform(db.Trans(-middle.x, -middle.y))
                instance.transform(db.Trans(quarters, False, 0, 0))
                instance.transform(db.Trans(middle.x, middle.y))

    return change


def edited(name, edit):
    def change(layout, layer):
        cell = layout.cell(name)
        region = db.Region(cell.begin_shapes_rec(layer)).merged()
        cell.shapes(layer).clear()
        cell.shapes(layer).insert(edit(region))

    return change


def modules(count):
    def edit(region):
        box, flips = region.bbox(), db.Region()
        for k in range(count):
            x, y = box.left + 200_000 * (5 + 3 * k), box.bottom + 200_000 * (6 + 2 * k)
            flips.insert(db.Box(x, y, x + 200_000, y + 200_000))
        return region ^ flips

    return edit


def mirrored_plate(layout, layer):
    layout.top_cell().transform(db.Trans(db.Trans.M90, 0, 0))


CHANGES = {
    "turned": turned,
    "nudged": nudged,
    "exchanged": exchanged,
    "missing": missing,
    "stray": stray,
    "mirrored plate": mirrored_plate,
    "mirrored F": mirrored_mark("PARITY"),
    "mirrored code": mirrored_mark("JOB_CODE"),
    "turned code": turned_mark("JOB_CODE"),
    "one module": edited("JOB_CODE", modules(1)),
    "three modules": edited("JOB_CODE", modules(3)),
    "seven modules": edited("JOB_CODE", modules(7)),
    "narrow bar": edited("CD_X_1X", lambda region: region.sized(-5, 0, 2)),
    "moved bar": edited("CD_X_1X", lambda region: region.moved(1, 0)),
    "lost letter": edited("TITLE", lambda region: db.Region(list(region.each())[1:])),
    "extra line": edited("TITLE", lambda region: region + region.moved(0, -3_000_000)),
}


@pytest.mark.parametrize("package", ["order_chrome"], indirect=True)
@pytest.mark.parametrize("change", CHANGES)
def test_what_is_changed_on_the_plate_is_found(referee, plate, tmp_path, change):
    assert judged(referee, plate, changed(plate, tmp_path, CHANGES[change])) != []


@pytest.mark.parametrize("package", ["order_chrome"], indirect=True)
def test_a_copy_by_another_writer_is_taken(referee, plate, tmp_path):
    assert judged(referee, plate, changed(plate, tmp_path, lambda layout, layer: None)) == []


@pytest.mark.parametrize("package", ["order_chrome"], indirect=True)
def test_units_are_judged(referee, plate, tmp_path):
    data = plate[1].read_bytes()
    at = data.index(b"\x00\x14\x03\x05") + 4
    for moved in (0, 8):
        wrong = bytearray(data)
        wrong[at + moved] += 1
        assert any("unit" in line for line in judged(referee, plate, bytes(wrong)))


@pytest.mark.parametrize("package", ["order_chrome"], indirect=True)
@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("die", 1, "seed"), 2),
        (("die", 0, "tiling"), "rot90"),
        (("job", "title"), "BAR OPENINGS, CHROME ON GLASX"),
        (("order", "parity"), "wrong reading"),
        (("order", "tone"), "dark"),
        (("camera", "pixel"), "3 um"),
    ],
)
def test_another_job_is_another_plate(referee, plate, path, value):
    job = json.loads((plate[0] / "job.json").read_text())
    part = job
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    assert judged(referee, plate, plate[1].read_bytes(), job)
