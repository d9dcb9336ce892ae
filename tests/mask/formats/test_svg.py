from __future__ import annotations

import re
from dataclasses import replace
from decimal import Decimal
from xml.etree import ElementTree

import pytest
from klayout import db

from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR
from maskfab.mask.figures import CUT, PolygonOptions, draw
from maskfab.mask.formats.svg import svg_bytes, write_svg
from maskfab.mask.layout import plate_layout, region

SVG = "{http://www.w3.org/2000/svg}"
LINK = "{http://www.w3.org/1999/xlink}href"


def outlines(path):
    """Polygons of the data of a path, in millimetres."""
    x = y = Decimal(0)
    for outline in path.split("Z")[:-1]:
        points = []
        for letter, numbers in re.findall(r"([MLHV])([^MLHV]*)", outline):
            values = [Decimal(number) for number in numbers.split()]
            if letter == "H":
                (x,) = values
            elif letter == "V":
                (y,) = values
            else:
                x, y = values
            points.append((x, y))
        yield points


def flattened(root, layer):
    """What a group shows, in nanometres, y upwards from the lower left corner of the picture."""
    symbols = {each.get("id"): each for each in root.iter(f"{SVG}symbol")}
    outer = root.find(f"{SVG}g")
    a, b, c, d, e, f = (Decimal(value) for value in re.findall(r"[-\d.]+", outer.get("transform")))
    assert (a, b, c, d) == (1, 0, 0, -1)
    height = Decimal(root.get("viewBox").split()[3])
    found = db.Region()
    for group in outer.findall(f"{SVG}g"):
        if group.get("id") != layer.name:
            continue
        for element in group:
            shift, drawn = (Decimal(0), Decimal(0)), element
            if element.tag == f"{SVG}use":
                shift = Decimal(element.get("x")), Decimal(element.get("y"))
                (drawn,) = symbols[element.get(LINK)[1:]]
            for points in outlines(drawn.get("d")):
                placed = [(x + shift[0] + e, height - (f - (y + shift[1]))) for x, y in points]
                assert all(value * 1_000_000 % 1 == 0 for point in placed for value in point)
                found.insert(db.Polygon([db.Point(int(x * 1_000_000), int(y * 1_000_000)) for x, y in placed]))
    return found


@pytest.mark.parametrize(
    "options",
    [
        PolygonOptions(),
        PolygonOptions(hierarchy="merged"),
        PolygonOptions(holes="layer"),
        PolygonOptions(max_references=19),
    ],
    ids=str,
)
@pytest.mark.parametrize("die", [None, "PERIODIC", "DENSE"])
def test_an_independent_reader_finds_the_design(small_plate, tmp_path, options, die):
    path = tmp_path / "x.svg"
    write_svg(draw(small_plate, options), path, die=die)
    root = ElementTree.parse(path).getroot()
    half = small_plate.blank_nm // 2
    boxes = {each.name: each.box_nm for each in small_plate.dies}
    box = boxes[die] if die else (-half, -half, half, half)
    design = region(plate_layout(small_plate), CLEAR, box).moved(-box[0], -box[1])
    shown = flattened(root, CLEAR) - flattened(root, CUT)
    assert (shown ^ design).is_empty()


def test_it_has_its_true_size(small_plate, tmp_path):
    write_svg(small_plate, tmp_path / "x.svg")
    root = ElementTree.parse(tmp_path / "x.svg").getroot()
    assert (root.get("width"), root.get("height"), root.get("viewBox")) == ("10mm", "10mm", "0 0 10 10")


def test_one_symbol_for_each_unit_cell_and_no_name_twice(small_plate, tmp_path):
    figures = draw(small_plate)
    write_svg(figures, tmp_path / "x.svg")
    root = ElementTree.parse(tmp_path / "x.svg").getroot()
    assert len(root.findall(f"{SVG}defs/{SVG}symbol")) == len(figures.cells)
    assert len(list(root.iter(f"{SVG}use"))) == 3 * 20
    names = [each.get("id") for each in root.iter() if each.get("id")]
    assert len(set(names)) == len(names)


def test_markup_in_texts_is_inert(small_plate, tmp_path):
    hostile = '</title><script>alert("1")</script>&amp;\x00\x1b'
    write_svg(replace(small_plate, title=hostile), tmp_path / "x.svg", [hostile, "]]>"])
    root = ElementTree.parse(tmp_path / "x.svg").getroot()
    assert not list(root.iter(f"{SVG}script"))
    assert root.findtext(f"{SVG}title").startswith('</title><script>alert("1")</script>&amp;')
    assert "]]>" in root.findtext(f"{SVG}desc")


def test_a_file_is_about_as_large_as_told(small_plate, tmp_path):
    figures = draw(small_plate)
    write_svg(figures, tmp_path / "x.svg", ["job 0123"])
    assert (tmp_path / "x.svg").stat().st_size <= 2 * svg_bytes(figures)


def test_bad_requests(small_plate, tmp_path):
    with pytest.raises(OutputError, match="MF415"):
        write_svg(small_plate, tmp_path / "x.svg", limit_bytes=1000)
    with pytest.raises(KeyError, match="NOBODY"):
        write_svg(small_plate, tmp_path / "x.svg", die="NOBODY")
    assert not list(tmp_path.iterdir())
