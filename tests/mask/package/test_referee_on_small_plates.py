"""The referee on small plates of every kind: it takes what is right, and names what was made otherwise than asked."""

from __future__ import annotations

import hashlib
import importlib.util
import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import zxingcpp
from klayout import db

from maskfab.base import __version__, resources
from maskfab.job.sections import JobSpec, PlateSection
from maskfab.job.shop import dump_shop
from maskfab.mask.houses.adaptation import fitted
from maskfab.mask.houses.files import files_for_shop
from maskfab.mask.houses.profiles import load_shop
from maskfab.mask.job import load_job

BAR, DENSE, POLED = (
    (f'opening = "openings/{name}.toml"', f'dot = "{dot} um"', f'pitch = "{pitch} um"')
    for name, dot, pitch in (("bar", 8, 168), ("paper_inv_random", 8, 168), ("poled", 4, 180))
)
PLAIN = [
    ("A", *BAR, 'tiling = "periodic"'),
    ("B", *DENSE, 'tiling = "random"', "seed = 3"),
    ("C", *POLED, 'tiling = "random"', "seed = 4", 'gutter = "12 um"'),
]
HEXAGONAL = [
    ("H1", *DENSE, 'tiling = "hexagonal"', "seed = 7"),
    ("H2", *POLED[:2], 'pitch = "168 um"', 'tiling = "hexagonal"', "seed = 11"),
]
OTHERS = [("O", *BAR, 'tiling = "random"', "seed = 3", 'others = ["openings/toled.toml"]')]
MAPPED = [("M", *BAR, 'tiling = "map"', "seed = 2", 'map = "map.toml"')]
MAP = """name = "moved"
map = \"\"\"
01234
56701
23456
70123
45670
\"\"\"
openings = \"\"\"
01201
20120
11022
02210
12001
\"\"\"
shifts = [[0, 0], [3, -1], [7, -5]]
"""
GRID = '[export]\ngrid = "20 nm"'
LAYOUTS = sorted(
    path.stem for path in (Path(__file__).parents[3] / "layouts").glob("*.toml") if "[[die]]" in path.read_text()
)
BIAS = 'bias = "data"\n[process]\ncd_bias = "{} nm"'


def written(folder, dies, order="", plate='template = "5in"', title="SMALL"):
    layouts = resources.path("layouts/openings").parent
    head = re.search(r"\[camera\].*?(?=\[plate\])", (layouts / "order_chrome.toml").read_text(), re.DOTALL)[0]
    text = f'[job]\nname = "SMALL"\ntitle = "{title}"\n' + head.replace('"4 mm"', '"0.5 mm"')
    text += f'[plate]\n{plate}\ndie_size = "1.2 mm"\ndie_pitch = "22 mm"\ncolumns = 2\n'
    for name, *lines in dies:
        text += "\n".join(["[[die]]", f'name = "{name}"', 'label = "x"', *lines, ""])
    path = folder / "small.toml"
    path.write_text(f"{text}[order]\n{order}\n".replace('"openings/', f'"{layouts}/openings/'))
    (folder / "map.toml").write_text(MAP)
    return path


def made(path, house="generic-chrome"):
    """The job as a package holds it, and the GDSII that a house is sent."""
    job, shop = load_job(path), load_shop(house)
    plate = fitted(job.plate(), shop, job.spec.tone)
    product = files_for_shop(plate, shop, ("gdsii",), [], "SMALL", job.spec, file=job.file).products[0]
    product.write(path.parent / product.name)
    return json.loads(json.dumps(job.spec.dump())), (path.parent / product.name).read_bytes()


@cache
def referee():
    spec = importlib.util.spec_from_file_location("referee", resources.path("export_templates/referee.py"))
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def wrong(job, data, house="generic-chrome"):
    judge = referee()
    kind = job["plate"].get("template")
    template = judge.toml(resources.template(f"plates/{kind}.toml")) if kind else None
    verdict, _ = judge.judge(job, template, __version__, data, None, judge.toml(dump_shop(load_shop(house))))
    assert verdict.unknown == []
    return verdict.wrong


@pytest.mark.parametrize(
    ("dies", "order"),
    [
        (HEXAGONAL, BIAS.format(200)),
        (OTHERS, ""),
        (MAPPED, ""),
        (PLAIN, BIAS.format(400)),
        (PLAIN, BIAS.format(-400)),
        (PLAIN, 'tone = "dark"\nchrome = "down"\n' + BIAS.format(400)),
        (PLAIN, GRID),
        (PLAIN, 'chrome = "down"\n' + GRID),
        (PLAIN, 'parity = "wrong reading"'),
        (PLAIN, 'parity = "wrong reading"\nchrome = "down"'),
        ([(*PLAIN[0], 'size = "0.6 mm"')], ""),
    ],
)
def test_plates_that_are_right_are_taken(tmp_path, dies, order):
    assert wrong(*made(written(tmp_path, dies, order))) == []


def test_job_codes_are_read_in_every_encodation_that_their_writer_chooses():
    """An order of digits and dots, as in a version and a hash that begins with digits, is written in EDIFACT."""
    for k in range(200):
        text = f"maskfab:1.0.0:{hashlib.sha256(str(k).encode()).hexdigest()}"
        symbol = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.DataMatrix, force_square=True)
        dark = (np.array(symbol.to_image(scale=1, add_quiet_zones=False)) == 0).tolist()
        assert referee().matrix(text, dark) == dark, text


@pytest.mark.parametrize(("order", "merged"), [("", False), ("", True), ('tone = "dark"', False)])
def test_flat_and_merged_files_are_taken_and_judged_alike(tmp_path, order, merged):
    job, _ = made(written(tmp_path, PLAIN, order))
    for moved in (0, 1):
        layout = db.Layout()
        layout.read(str(tmp_path / "SMALL.gds"))
        top = layout.top_cell()
        top.flatten(True)
        for layer in layout.layer_indexes():
            region = db.Region(top.begin_shapes_rec(layer))
            first, *others = (region.merged() if merged else region).each()
            top.shapes(layer).clear()
            for polygon in (first.moved(moved, 0), *others):
                top.shapes(layer).insert(polygon)
        layout.write(str(tmp_path / "flat.gds"))
        assert bool(wrong(job, (tmp_path / "flat.gds").read_bytes())) == bool(moved)


@pytest.mark.parametrize("order", ['tone = "dark"', BIAS.format(400)])
def test_plates_without_a_template_are_taken(tmp_path, order):
    assert wrong(*made(written(tmp_path, PLAIN, order, plate='blank = "5 in"\nwritable = "100 mm"'))) == []


@pytest.mark.parametrize("plate", ['template = "5in"', 'blank = "5 in"\nwritable = "100 mm"'])
def test_a_serial_number_is_read_in_the_title(tmp_path, monkeypatch, plate):
    path = written(tmp_path, PLAIN[:1], plate=f'{plate}\nserial = "A-017"')
    assert wrong(*made(path)) == []
    monkeypatch.setattr(PlateSection, "texts", {"serial": "A-011"})
    assert wrong(*made(path)) != []


@pytest.mark.parametrize("tone", ["clear", "dark"])
def test_corner_squares_of_a_house_are_asked_for_there_and_nowhere_else(tmp_path, tone):
    job, data = made(written(tmp_path, PLAIN[:1], f'tone = "{tone}"'), "gesim")
    assert wrong(job, data, "gesim") == []
    assert any(line.startswith("plate: 16") for line in wrong(job, data))


@pytest.mark.parametrize(
    ("asked", "drawn", "named"),
    [
        ((PLAIN,), ([PLAIN[1], PLAIN[0], PLAIN[2]],), "die A"),
        ((PLAIN,), (PLAIN, "", 'template = "5in"', "SMALK"), "mark TITLE"),
        ((PLAIN,), (PLAIN, 'chrome = "down"'), "mark PARITY"),
        ((PLAIN,), (PLAIN, 'tone = "dark"'), "layer 3/0"),
        ((PLAIN, BIAS.format(400)), (PLAIN, BIAS.format(-400)), "mark CD_X_1X"),
        ((PLAIN, BIAS.format(400)), (PLAIN, BIAS.format(400).replace("data", "none")), "die B"),
        ((HEXAGONAL,), ([(*HEXAGONAL[0][:-1], "seed = 8"), HEXAGONAL[1]],), "die H1"),
        ((OTHERS,), ([(*OTHERS[0][:-1], 'others = ["openings/bar.toml"]')],), "die O"),
        ((PLAIN,), ([PLAIN[0], (*PLAIN[1][:-1], "seed = 5"), PLAIN[2]],), "die B"),
    ],
)
def test_what_was_made_otherwise_is_named(tmp_path, asked, drawn, named):
    job, _ = made(written(tmp_path, *asked))
    _, data = made(written(tmp_path, *drawn))
    assert any(line.startswith(named) for line in wrong(job, data)), wrong(job, data)


def flipped(rows):
    return rows[::-1]


def transposed(rows):
    return ["".join(column) for column in zip(*rows, strict=True)]


def moved(rows):
    return [row[-1] + row[:-1] for row in rows]


def mirrored(rows):
    return [row[::-1] for row in rows]


@pytest.mark.parametrize("change", [flipped, transposed, moved, mirrored])
@pytest.mark.parametrize(("part", "dies", "named"), [("openings", PLAIN, "die A"), ("maps", MAPPED, "die M")])
def test_openings_and_maps_read_another_way_are_found(tmp_path, change, part, dies, named):
    """As if the plate had been drawn of the picture as it is, and the job's held it changed."""
    job, data = made(written(tmp_path, dies))
    assert wrong(job, data) == []
    name = next(iter(job[part]))
    key = re.search(r'(?:grid|map) = """\n(.*?)\n"""', job[part][name], re.DOTALL)[1]
    job[part][name] = job[part][name].replace(key, "\n".join(change(key.split())))
    assert any(line.startswith(named) for line in wrong(job, data))


@pytest.mark.parametrize(
    ("member", "value", "order"),
    [
        ("mirrored", True, ""),
        ("mirrored", False, 'chrome = "down"'),
        ("tone", "dark", ""),
        ("data_bias_nm", 0, BIAS.format(400)),
        ("data_bias_nm", -400, BIAS.format(400)),
    ],
)
def test_faults_in_the_making_are_found(tmp_path, monkeypatch, member, value, order):
    path = written(tmp_path, PLAIN, order)
    monkeypatch.setattr(JobSpec, member, property(lambda self: value))
    assert wrong(*made(path)) != []


@pytest.mark.parametrize(
    ("order", "plate"), [("", 'template = "5in"'), ('tone = "dark"', 'blank = "5 in"\nwritable = "100 mm"')]
)
def test_a_job_s_own_text_is_read_beside_its_openings(tmp_path, capsys, order, plate):
    path = written(tmp_path, [*PLAIN[:2], *MAPPED], order, plate)
    job, data = made(path)
    (tmp_path / "plate.gds").write_bytes(data)
    template = [str(resources.path("export_templates/plates/5in.toml"))] if "template" in plate else []
    asked = [str(path), str(tmp_path / "plate.gds"), *template, "--version", __version__]
    assert referee().main(asked) == 0
    assert f"the title says {referee().digest_of(job)[:16]}" in capsys.readouterr().out
    path.write_text(path.read_text().replace("seed = 3", "seed = 4"))
    assert referee().main([str(path), str(tmp_path / "plate.gds"), *template, "--version", __version__]) == 1
    assert "WRONG die B" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("house", ["generic-chrome", "gesim", "heidelberg_dwl66", "jd_photo_data"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_plate_that_is_shipped_is_taken(layout, house, tmp_path):
    path = resources.path(f"layouts/{layout}.toml")
    copy = tmp_path / "job.toml"
    copy.write_text(re.sub(r'"(openings|maps|cameras)/', rf'"{path.parent}/\1/', path.read_text()))
    assert wrong(*made(copy, house), house) == []
