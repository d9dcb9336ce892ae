"""SVG read back: written pictures are the design, and what is not such a picture is refused, however it is damaged."""

from __future__ import annotations

import numpy as np
import pytest
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.formats.svg import read_svg, write_svg
from maskfab.mask.layout import plate_layout, region

PICTURE = """\
<?xml version="1.0" encoding="UTF-8"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" \
width="4mm" height="2mm" viewBox="0 0 4 2">
<defs><symbol id="A"><path d="M0 0H0.003V0.001H0Z"/></symbol></defs>
<g transform="matrix(1 0 0 -1 2 1)">
<g id="CLEAR">
<use xlink:href="#A" x="1" y="0.5"/>
<use xlink:href="#A" x="-1" y="-0.5"/>
<path d="M0 0L0.002 0L0 -0.002ZM0.01 0H0.011V0.001H0.01Z"/>
</g>
</g>
</svg>
"""


def read(folder, text=PICTURE):
    path = folder / "x.svg"
    path.write_text(text, encoding="utf-8")
    return read_svg(path)


def refusal(folder, text):
    with pytest.raises(SourceError) as caught:
        read(folder, text)
    return caught.value


@pytest.mark.parametrize(
    "options", [PolygonOptions(), PolygonOptions(hierarchy="merged"), PolygonOptions(max_references=19)], ids=str
)
def test_a_written_picture_is_the_design(small_plate, tmp_path, options):
    write_svg(draw(small_plate, options), tmp_path / "x.svg")
    layout = read_svg(tmp_path / "x.svg")
    design = region(plate_layout(small_plate), CLEAR)
    assert (region(layout, CLEAR) ^ design).is_empty()
    assert len(layout.top_cells()) == 1


def test_a_cell_is_held_once_however_often_it_is_used(small_plate, tmp_path):
    write_svg(draw(small_plate, PolygonOptions()), tmp_path / "x.svg")
    layout = read_svg(tmp_path / "x.svg")
    top = layout.top_cell()
    kinds = sum(np.unique(die.panel.orientations).size for die in small_plate.dies)
    assert 8 < layout.cells() - 1 <= kinds
    assert top.child_instances() == 3 * 20


def test_every_number_is_a_millimetre_from_the_middle_with_y_upwards(tmp_path):
    found = region(read(tmp_path), CLEAR)
    wanted = db.Region()
    for x, y in ((1_000_000, 500_000), (-1_000_000, -500_000)):
        wanted.insert(db.Box(x, y, x + 3000, y + 1000))
    wanted.insert(db.Polygon([db.Point(0, 0), db.Point(2000, 0), db.Point(0, -2000)]))
    wanted.insert(db.Box(10_000, 0, 11_000, 1000))
    assert (found ^ wanted).is_empty()
    assert found.merged().area() == 2 * 3_000_000 + 2_000_000 + 1_000_000


WRONG = {
    "no xml": ("<svg ", "<<svg "),
    "entity": ('<g id="CLEAR">', '<g id="CLEAR">&unknown;'),
    "no group": ('<g transform="matrix(1 0 0 -1 2 1)">', '<g transform="matrix(1 0 0 -1 2 1)" xmlns="urn:x">'),
    "upside down": ("matrix(1 0 0 -1 2 1)", "matrix(1 0 0 1 2 1)"),
    "mirrored": ("matrix(1 0 0 -1 2 1)", "matrix(-1 0 0 -1 2 1)"),
    "scaled": ("matrix(1 0 0 -1 2 1)", "matrix(2 0 0 -2 2 1)"),
    "shifted": ("matrix(1 0 0 -1 2 1)", "matrix(1 0 0 -1 2.000001 1)"),
    "not transformed": (' transform="matrix(1 0 0 -1 2 1)"', ""),
    "cut off": ('viewBox="0 0 4 2"', 'viewBox="1 0 4 2"'),
    "no view": (' viewBox="0 0 4 2"', ""),
    "another unit": ('width="4mm"', 'width="4in"'),
    "another size": ('height="2mm"', 'height="4mm"'),
    "a turned use": ('x="1"', 'transform="rotate(90)" x="1"'),
    "a scaled symbol": ("<path d=", '<path transform="scale(2)" d='),
    "unknown layer": ('id="CLEAR"', 'id="METAL"'),
    "unknown symbol": ('"#A" x="1"', '"#B" x="1"'),
    "no link": ('xlink:href="#A" x="1"', 'x="1"'),
    "a curve": ("L0 -0.002", "Q0 -0.002"),
    "relative": ("H0.003", "h0.003"),
    "too few numbers": ("L0 -0.002", "L0"),
    "too many numbers": ("H0.003", "H0.003 4"),
    "open": ('H0.01Z"', 'H0.01"'),
    "no path": ('<path d="M0 0L', '<path e="M0 0L'),
    "no number": ("H0.003", "H.."),
    "off the grid": ('x="1"', 'x="1.0000005"'),
    "beyond all coordinates": ('x="1"', 'x="1000000000000"'),
    "a polygon beyond all coordinates": ("H0.003", "H1000000000000"),
    "beyond all integers": ('x="1"', 'x="99999999999999999999"'),
    "endless": ('x="1"', 'x="Infinity"'),
    "nowhere": ('x="1"', 'x="NaN"'),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_such_picture_is_refused(tmp_path, case):
    old, new = WRONG[case]
    assert old in PICTURE
    error = refusal(tmp_path, PICTURE.replace(old, new, 1))
    assert error.code == "MF303"
    assert "x.svg" in error.what
    assert error.cure


def test_a_missing_file_and_a_folder_are_refused(tmp_path):
    (tmp_path / "folder.svg").mkdir()
    for name in ("none.svg", "folder.svg"):
        with pytest.raises(SourceError) as caught:
            read_svg(tmp_path / name)
        assert caught.value.code == "MF301"


def test_damage_anywhere_is_refused_or_changes_what_is_read_but_never_crashes(tmp_path):
    rng, text = np.random.default_rng(5), PICTURE.encode()
    path, codes = tmp_path / "x.svg", set[str]()
    for _ in range(400):
        damaged = bytearray(text)
        for place in rng.integers(0, len(text), 2):
            damaged[place] = rng.integers(0, 256)
        cut = int(rng.integers(1, len(text))) if rng.random() < 0.2 else len(text)
        path.write_bytes(damaged[:cut])
        try:
            layout = read_svg(path)
        except SourceError as error:
            codes.add(error.code)
        else:
            region(layout, CLEAR)
    assert codes == {"MF303"}
