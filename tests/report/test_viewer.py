"""The page that shows a plate: its polygons are those of the mask file, its words inert, its run proved."""

from __future__ import annotations

import base64
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from klayout import db
from small_job import DRAWING, command, edited, finished

import maskfab as mf
from maskfab.base.errors import OutputError
from maskfab.base.folders import finished as known
from maskfab.base.model import CLEAR
from maskfab.base.provenance import sha256_of_file
from maskfab.mask.design_rules import RuleResult
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import region
from maskfab.mask.plate_rules import write_markers
from maskfab.report.pages.viewer import drawn_cells, inert_json, packed, psf_pictures, rule_places, shown_run

HOSTILE = 'A</script><script>alert("x")</script><!-- é'


def unpacked(text: str) -> list[int]:
    numbers, value, bits = [], 0, 0
    for byte in base64.b64decode(text):
        value |= (byte & 127) << bits
        bits += 7
        if byte < 128:
            numbers.append(value >> 1 if value % 2 == 0 else -(value + 1) // 2)
            value = bits = 0
    return numbers


def points(text: str) -> list[tuple[int, int]]:
    return [tuple(each) for each in np.cumsum(np.reshape(unpacked(text), (-1, 2)), axis=0).tolist()]


def polygons(text: str) -> list[db.Polygon]:
    """From the numbers of one layer of one cell."""
    numbers, found, x, y = iter(unpacked(text)), [], 0, 0
    for contours in numbers:
        rings = []
        for _ in range(contours):
            ring = []
            for _ in range(next(numbers)):
                x, y = x + next(numbers), y + next(numbers)
                ring.append(db.Point(x, y))
            rings.append(ring)
        polygon = db.Polygon(rings[0], True)
        for hole in rings[1:]:
            polygon.insert_hole(hole, True)
        found.append(polygon)
    return found


def rebuilt(document: dict) -> db.Layout:
    """A layout again, of what a page is told."""
    layout = db.Layout()
    layout.dbu = 0.001
    layers = [layout.layer(*map(int, each["numbers"].split("/"))) for each in document["layers"]]
    cells = [layout.create_cell(each["name"]) for each in document["cells"]]
    for cell, told in zip(cells, document["cells"], strict=True):
        for layer, text in told["shapes"]:
            for polygon in polygons(text):
                cell.shapes(layers[layer]).insert(polygon)
        for group in told["groups"]:
            a, b, c, d = group["turn"]
            (ax, ay), (bx, by) = group["steps"]
            for x, y in points(group["at"]):
                turn = turned(a, b, c, d, x, y)
                child = cells[group["cell"]].cell_index()
                columns, rows = group["counts"]
                if (columns, rows) == (1, 1):
                    cell.insert(db.CellInstArray(child, turn))
                else:
                    cell.insert(db.CellInstArray(child, turn, db.Vector(ax, ay), db.Vector(bx, by), columns, rows))
    assert layout.top_cell().cell_index() == cells[document["top"]].cell_index()
    return layout


def turned(a: float, b: float, c: float, d: float, x: int, y: int) -> db.ICplxTrans:
    scale = float(np.hypot(a, b))
    return db.ICplxTrans(scale, float(np.rad2deg(np.arctan2(b, a))), a * d - b * c < 0, x, y)


def differences(one: db.Layout, other: db.Layout) -> int:
    """Area, nm², in which two layouts differ on any layer; not merged, so that polygons drawn twice count."""
    infos = {str(info): info for layout in (one, other) for info in layout.layer_infos()}
    area = 0
    for info in infos.values():
        regions = []
        for layout in (one, other):
            index = layout.find_layer(db.LayerInfo(info.layer, info.datatype))
            drawn = db.Region() if index is None else db.Region(layout.top_cell().begin_shapes_rec(index))
            drawn.merged_semantics = False
            regions.append(drawn)
        area += (regions[0] ^ regions[1]).area() + abs(regions[0].area() - regions[1].area())
    return area


@given(st.lists(st.integers(-(2**62), 2**62) | st.integers(-200, 200)))
def test_numbers_come_back_from_their_text(numbers):
    assert unpacked(packed(numbers)) == numbers


def test_the_polygons_told_are_those_of_the_mask_file(small_result):
    layout = read_layout(small_result / "SMALL.gds")
    document = drawn_cells(layout)
    assert differences(rebuilt(document), layout) == 0
    placed = sum(len(points(group["at"])) for cell in document["cells"] for group in cell["groups"])
    assert sum(len(polygons(text)) for cell in document["cells"] for _, text in cell["shapes"]) < 1000
    assert placed >= 100  # the random die has a reference for every cell


def test_holes_paths_boxes_arrays_and_turned_references_are_told_exactly():
    layout = db.Layout()
    layout.dbu = 0.001
    clear, wire = layout.layer(1, 0), layout.layer(30, 0)
    small, middle, top, lost = (layout.create_cell(name) for name in ("small", "middle", "TOP", "lost"))
    ring = db.Polygon(db.Box(0, 0, 900, 700))
    ring.insert_hole(db.Box(200, 200, 300, 500))
    small.shapes(clear).insert(ring)
    small.shapes(wire).insert(db.Path([db.Point(0, 0), db.Point(5000, 0), db.Point(5000, 3000)], 80))
    middle.shapes(clear).insert(db.Box(-50, -2_000_000_000, 50, 2_000_000_000))
    for turn in range(8):
        middle.insert(db.CellInstArray(small.cell_index(), db.Trans(turn % 4, turn > 3, 7000 * turn, -3)))
    step = db.Vector(40_000, 0), db.Vector(100, 9_000)
    middle.insert(db.CellInstArray(small.cell_index(), db.Trans(5, 6), *step, 3, 4))
    top.insert(db.CellInstArray(middle.cell_index(), db.Trans(1, True, 11, 12)))
    top.insert(db.CellInstArray(small.cell_index(), db.ICplxTrans(2.0, 90.0, True, 1, 2)))
    lost.shapes(clear).insert(db.Box(1, 1))
    lost.delete()
    assert differences(rebuilt(drawn_cells(layout)), layout) == 0


def test_a_layer_tells_how_many_shapes_it_draws_and_where():
    layout = db.Layout()
    cell, top = layout.create_cell("PIXEL"), layout.create_cell("TOP")
    cell.shapes(layout.layer(1, 0)).insert(db.Box(0, 0, 20, 50))
    top.insert(db.CellInstArray(cell.cell_index(), db.Trans(), db.Vector(100, 0), db.Vector(0, 100), 3, 2))
    top.shapes(layout.layer(11, 0)).insert(db.Text("a note", db.Trans(7, 9)))
    told = {layer["numbers"]: (layer["drawn"], layer["box"]) for layer in drawn_cells(layout)["layers"]}
    assert told == {"1/0": (6, [0, 0, 220, 150]), "11/0": (0, [7, 9, 7, 9])}


def test_places_of_rules_are_those_of_the_markers(tmp_path):
    found = RuleResult("corner_touch", 0, "nm", 0, 5, ((1, 2, 3, 4), (-7, 8, -7, 8)), "PLAIN")
    write_markers([found], "TOP", tmp_path / "p.lyrdb")
    (rule,) = rule_places(tmp_path / "p.lyrdb")
    assert np.cumsum(np.reshape(unpacked(rule["places"]), (-1, 4)), axis=0).tolist() == [[1, 2, 3, 4], [-7, 8, -7, 8]]
    assert rule["told"] == ["die PLAIN: 5 in all, worst 0 nm"]


def test_only_pictures_that_lie_in_the_page_are_taken():
    page = (
        '<section id="die-A"><img alt="Panel" src="data:image/png;base64,AA"><img alt="PSF at 530 nm" src="data:image/'
        'svg+xml,%3Csvg%3E"></section><section id="die-B"><img alt="PSF at 1 nm" src="https://example.org/p.png">'
        '</section><section id="plate"><img alt="PSF at 2 nm" src="data:image/png;base64,BB"></section>'
    )
    assert psf_pictures(page) == {"A": ("data:image/svg+xml,%3Csvg%3E", "PSF at 530 nm")}


def test_names_end_no_element():
    text = inert_json({"title": HOSTILE})
    assert json.loads(text) == {"title": HOSTILE}
    assert not set(text) & set("<>&")


@pytest.fixture(scope="module")
def hostile(tmp_path_factory) -> Path:
    """A run whose words are markup."""
    words = ('title = "SMALL PLATE"', "title = 'A</script><b>x&'"), ('label = "periodic"', "label = '<i>periodic'")
    return finished(tmp_path_factory.mktemp("hostile"), *words)


def test_a_page_is_complete_in_itself_and_equal_runs_give_equal_bytes(hostile, tmp_path, capsys):
    made = mf.view(hostile, tmp_path / "one.html")
    said = command(capsys, "view", hostile, "--out", tmp_path / "two.html", "--json")
    page = made.path.read_text(encoding="utf-8")
    assert page == (tmp_path / "two.html").read_text(encoding="utf-8")
    assert said.document == made.to_dict() | {"page": str(tmp_path / "two.html")}
    assert made.sha256 == sha256_of_file(hostile / "SMALL.gds")
    assert made.sha256 in page
    assert len(re.findall("<script", page)) == len(re.findall("</script", page)) == 2
    assert not re.findall(r"<(?:link|iframe|object|embed|base)\b|https?://|\bimport\b|fetch\(|<b>|<i>", page)


def test_the_page_lies_beside_the_run_which_stays_as_it_was(small_result, tmp_path):
    run = shutil.copytree(small_result, tmp_path / "run")
    assert mf.view(run).path == tmp_path / "run.html"
    with pytest.raises(OutputError, match="MF402"):
        mf.view(run)
    with pytest.raises(OutputError, match=r"MF401.*manifest does not know it"):
        mf.view(run, run / "view.html")
    assert known(run).strange == ()


def test_what_a_page_would_show_must_be_as_the_run_wrote_it(small_result, tmp_path):
    with pytest.raises(OutputError, match="MF403"):
        mf.view(tmp_path / "nowhere")
    with pytest.raises(OutputError, match="MF403"):
        mf.view(tmp_path, tmp_path.parent / "view.html")
    for name in ("SMALL.gds", "SMALL.lyrdb", "report.html", "report.json"):
        run = shutil.copytree(small_result, tmp_path / name)
        content = (run / name).read_bytes()
        (run / name).write_bytes(content + b"\n")
        with pytest.raises(OutputError, match=f"MF407.*{name} was changed"):
            mf.view(run)
    run = shutil.copytree(small_result, tmp_path / "gone")
    (run / "SMALL.gds").unlink()
    with pytest.raises(OutputError, match=r"MF407.*cannot be read"):
        mf.view(run)


def test_a_flat_file_is_shown_with_its_dies_where_they_were(small_result, tmp_path):
    run = shutil.copytree(small_result, tmp_path / "run")
    before = shown_run(run)
    edited(run / "SMALL.gds", run / "SMALL.gds", lambda layout: layout.top_cell().flatten(True))
    manifest = json.loads((run / "manifest.json").read_text())
    next(row for row in manifest["files"] if row["path"] == "SMALL.gds")["sha256"] = sha256_of_file(run / "SMALL.gds")
    (run / "manifest.json").write_text(json.dumps(manifest))
    after = shown_run(run)
    assert (len(before["cells"]) > 10, sum(bool(cell["shapes"]) for cell in after["cells"])) == (True, 1)
    assert [die["box"] for die in after["dies"]] == [die["box"] for die in before["dies"]]
    assert differences(rebuilt(after), rebuilt(before)) == 0


def test_a_run_without_polygons_is_refused_with_the_format_to_add(small_result, tmp_path):
    run = shutil.copytree(small_result, tmp_path / "run")
    manifest = json.loads((run / "manifest.json").read_text())
    manifest["files"] = [row for row in manifest["files"] if Path(row["path"]).suffix not in (".gds", ".oas", ".dxf")]
    (run / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(OutputError, match=r'MF409.*Add "gdsii" or "oasis"'):
        mf.view(run)


# --- In a browser ---------------------------------------------------------------------------------------------------

LOOK = """
const answers = {};
const side = 140, canvas = newCanvas(side, side), seen = canvas.getContext("2d");
const clear = told.layers.findIndex((layer) => layer.name === "CLEAR");
for (const scale of [1 / 4000, 1 / 56000]) {
  for (const die of told.dies) {
    seen.setTransform(1, 0, 0, 1, 0, 0);
    seen.clearRect(0, 0, side, side);
    new Painter(looks).paint(seen, top_, [scale, 0, 0, -scale, -die.box[0] * scale, die.box[3] * scale], [side, side],
      new Set([clear]));
    const pixels = seen.getImageData(0, 0, side, side).data;
    answers[`${die.name} ${Math.round(1 / scale)}`] = [...pixels].filter((_, at) => at % 4 === 3);
  }
}
const corner = told.dies[0].box.slice(0, 2).map((each, axis) => each + [24000, 8000][axis]);
answers.near = snapped(top_, new Set([clear]), [corner[0] + 300, corner[1] - 200], 1000, 1e-3);
answers.edge = snapped(top_, new Set([clear]), [corner[0] + 3500.4, corner[1] - 200], 1000, 1e-3);
answers.far = snapped(top_, new Set([clear]), [told.box[0] - 9e6, 0], 1000, 1e-3);
answers.title = byId("panel").ownerDocument.querySelector("h1").textContent;
answers.fetched = performance.getEntriesByType("resource").length;
answers.bold = document.querySelectorAll("b, i").length;
answers.wide = document.documentElement.scrollWidth <= window.innerWidth;
const pre = document.createElement("pre");
pre.id = "answers";
pre.textContent = JSON.stringify(answers);
document.body.append(pre);
"""


@pytest.fixture(scope="module")
def answers(browser, hostile, tmp_path_factory) -> dict:
    place = tmp_path_factory.mktemp("viewer")
    page = mf.view(hostile, place / "view.html").path.read_text(encoding="utf-8")
    (place / "look.html").write_text(page.replace("</body>", f"<script>{{{LOOK}}}</script></body>"), encoding="utf-8")
    browser.open(place / "look.html")
    return json.loads(browser.until("return document.querySelector('#answers')?.textContent"))


def corner(hostile: Path, name: str) -> db.Vector:
    """Lower left corner of a die in the mask file."""
    layout = read_layout(hostile / "SMALL.gds")
    return next(each.trans.disp for each in layout.top_cell().each_inst() if each.cell.name == name)


@pytest.mark.parametrize("name", ["PLAIN", "TURNED"])
def test_a_browser_draws_the_dots_of_the_mask_file(answers, hostile, name):
    """Two pixels for a dot: covered where the file is clear; then one for a cell: by as much as its cell is clear."""
    box = db.Box(0, 0, 560_000, 560_000).moved(corner(hostile, name))
    clear = region(read_layout(hostile / "SMALL.gds"), CLEAR, (box.left, box.bottom, box.right, box.top))
    middles = [[(box.left + 4000 * x + 2000, box.top - 4000 * y - 2000) for x in range(140)] for y in range(140)]
    probes = db.Region([db.Box(x - 1, y - 1, x + 1, y + 1) for row in middles for x, y in row])
    lit = {(each.bbox().center().x, each.bbox().center().y) for each in (probes & clear).each()}
    fine = np.reshape(answers[f"{name} 4000"], (140, 140))
    assert set(np.unique(fine)) == {0, 255}
    assert np.array_equal(fine > 127, [[each in lit for each in row] for row in middles])
    coarse = np.reshape(answers[f"{name} 56000"], (140, 140))[:10, :10] / 255
    assert coarse == pytest.approx(DRAWING.count("#") / 49, abs=0.02)


def test_the_ruler_snaps_to_corners_then_edges_of_the_file(answers, hostile):
    """Of the cell's lowest dots, which begin at column 3 of row 1, all in nm."""
    low = corner(hostile, "PLAIN")
    assert answers["near"] == {"x": low.x + 24_000, "y": low.y + 8000, "on": "corner"}
    assert answers["edge"] == {"x": pytest.approx(low.x + 27_500.4), "y": low.y + 8000, "on": "edge"}
    assert answers["far"] is None


def test_hostile_words_are_words_and_nothing_is_fetched(answers):
    assert answers["title"] == "A</script><b>x&"
    assert (answers["fetched"], answers["bold"], answers["wide"]) == (0, 0, True)
