from __future__ import annotations

import re

import pytest
from klayout import db

from maskfab.base.errors import OutputError
from maskfab.base.model import CHROME, CLEAR, OUTLINE
from maskfab.mask.figures import CUT, PolygonOptions, draw
from maskfab.mask.formats.cif import write_cif
from maskfab.mask.layout import layer_info, region

every_way = pytest.mark.parametrize(
    "options",
    [
        PolygonOptions(),
        PolygonOptions(hierarchy="flat"),
        PolygonOptions(hierarchy="merged"),
        PolygonOptions(holes="layer", notes="polygons"),
        PolygonOptions(tone="dark"),
        PolygonOptions(max_references=19),
    ],
    ids=str,
)


def by_klayout(path):
    layout = db.Layout()
    layout.read(str(path))
    return layout


@every_way
def test_klayout_finds_every_layer_of_the_figures(small_plate, tmp_path, options):
    figures, path = draw(small_plate, options), tmp_path / "x.cif"
    write_cif(figures, path)
    read, drawn = by_klayout(path), figures.layout()
    assert [cell.name for cell in read.top_cells()] == [figures.top]
    assert sorted(cell.name for cell in read.each_cell()) == sorted(cell.name for cell in drawn.each_cell())
    for layer in (CLEAR, CHROME, CUT, OUTLINE):
        assert (region(read, db.LayerInfo(layer.number, 0)) ^ region(drawn, layer_info(layer))).is_empty()


def test_every_command_is_one_of_the_grammar(small_plate, tmp_path):
    """Mead and Conway's, and the user extension that names a symbol; layers have names of four letters at most."""
    path = tmp_path / "x.cif"
    write_cif(small_plate, path, ["job (0123); E", "a µ) b"])
    *commands, end = path.read_text(encoding="ascii").split(";\n")
    assert end == "E\n"
    number = r"-?\d+"
    grammar = (
        rf"\([^()]*\)|DS \d+ 1 10|9 [A-Z0-9_]+|L [A-Z0-9]{{1,4}}|P(?: {number} {number}){{3,}}|"
        rf"C\d+(?: R1 0)?(?: T{number} {number})?|DF"
    )
    assert [command for command in commands if not re.fullmatch(grammar, command)] == []
    assert commands[:2] == ["(job [0123], E)", "(a _] b)"]
    defined = [int(command.split()[1]) for command in commands if command.startswith("DS")]
    assert commands[-1] == f"C{defined[-1]}"


def test_a_file_that_would_be_too_large_is_not_begun(small_plate, tmp_path):
    with pytest.raises(OutputError, match="MF415"):
        write_cif(small_plate, tmp_path / "x.cif", limit_bytes=1000)
    assert not list(tmp_path.iterdir())
