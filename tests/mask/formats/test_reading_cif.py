"""CIF by its grammar: what it says, what klayout must say too, and what is refused."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some
from klayout import db

from maskfab.base.errors import SourceError
from maskfab.base.model import CLEAR
from maskfab.mask.formats.cif import cif_content, write_cif
from maskfab.mask.formats.content import find_layer, rounding_nm
from maskfab.mask.formats.table import read_layout
from maskfab.mask.layout import MOST_CELLS, region

SQUARE = "P 0 0 40 0 40 40 0 40"
HEAD = "DS 1 1 10; 9 TOP; L L1; "


def written(tmp_path, text):
    path = tmp_path / "x.cif"
    path.write_text(text, encoding="latin-1")
    return path


def refused(tmp_path, text):
    with pytest.raises(SourceError) as caught:
        read_layout(written(tmp_path, text))
    assert "x.cif" in str(caught.value)
    return caught.value


@pytest.mark.parametrize(
    ("text", "corners"),
    [
        (f"{HEAD}{SQUARE}; DF; C 1; E", (0, 0, 40, 40)),
        (f"(a (nested); one);{HEAD}{SQUARE}; ; DF; C 1; E\n\n", (0, 0, 40, 40)),
        ("DS1;L L1D0;BLength 4Width 8at 5,5;DF;C1;E", (30, 10, 70, 90)),
        ("DS 1; L L1D0_CLEAR; B 4 8 5 5 0 -3; DF; E", (10, 30, 90, 70)),
        ("DS 1 2 4; L 1; P 0,0 4,0 4,4 0,4; D F; C 1; E", (0, 0, 20, 20)),
        ("L CLEAR; P 0 0 4 0 4 4 0 4; E", (0, 0, 40, 40)),
        (f"{HEAD}{SQUARE}; DF; DS 2 1 10; C 1 M X T 50 0 R 0 1; DF; C 2; E", (-40, 10, 0, 50)),
        (f"{HEAD}{SQUARE}; DF; DS 2 1 10; C 1 R 0 -2 M Y T -1 -1; DF; C 2; E", (-1, -1, 39, 39)),
        (f"{HEAD}{SQUARE}; 94 a_label 3 4; DF; DS 2 1 10; 94 'b c' 3,4 0; C 1 T 1 1; DF; C 2; E", (1, 1, 41, 41)),
    ],
)
def test_what_a_file_says(tmp_path, text, corners):
    layout = read_layout(written(tmp_path, text))
    assert region(layout, find_layer(layout)).bbox() == db.Box(*corners)
    assert find_layer(layout).is_equivalent(db.LayerInfo(1, 0))
    assert rounding_nm(layout) == 0


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        (f"{HEAD}{SQUARE}; DF; C 1;", "MF303", "ends without E"),
        (f"{HEAD}{SQUARE}; DF; C 1; E C 1;", "MF303", "behind its end"),
        (f"{HEAD}{SQUARE}; E", "MF303", "has no end"),
        (f"{HEAD}P 0 0 40 0 40; DF; C 1; E", "MF303", "half a corner"),
        (f"{HEAD}P 0 0 4x 0 4-0 9 9; DF; C 1; E", "MF303", "numbers"),
        (f"{HEAD}P 0 0 99999999999 0 9 9; DF; C 1; E", "MF303", "numbers"),
        (f"{HEAD}P 0 0 9999999999 0 9 9; DF; C 1; E", "MF303", "2.1 m"),
        (f"{HEAD}B 0 4 5 5; DF; C 1; E", "MF303", "no area"),
        (f"{HEAD}{SQUARE}; DF; C 7; E", "MF303", "lacks"),
        (f"{HEAD}C 7; DF; C 1; E", "MF303", "lacks: C7"),
        (f"{HEAD}{SQUARE}; C 1; DF; C 1; E", "MF303", "contains itself"),
        (f"{HEAD}{SQUARE}; C 2; DF; DS 2; 9 B; C 1; DF; C 1; E", "MF303", "contains itself"),
        (f"{HEAD}{SQUARE}; DF; DS 1; DF; E", "MF303", "twice"),
        (f"{HEAD}{SQUARE}; DF; DS 2; 9 TOP; DF; E", "MF303", "two cells"),
        (f"{HEAD}{SQUARE}; DS 2; DF; DF; E", "MF303", "within another"),
        (f"DS 1 1 0; L L1; {SQUARE}; DF; E", "MF303", "scale"),
        (f"DS 1; {SQUARE}; DF; E", "MF303", "before it has named a layer"),
        (f"({HEAD}{SQUARE}; DF; C 1; E", "MF303", "comment"),
        (f"{HEAD}P 0 0 (what) 4 0 4 4; DF; C 1; E", "MF303", "no command"),
        (f"{HEAD}X; DF; C 1; E", "MF303", "no command"),
        (f"{HEAD}R 10 0 0; DF; C 1; E", "MF311", "round flashes"),
        (f"{HEAD}W 2 0 0 10 0; DF; C 1; E", "MF315", "wires"),
        (f"{HEAD}{SQUARE}; DF; C 1 R 1 1; E", "MF315", "quarters"),
        (f"{HEAD}{SQUARE}; DF; DD 1; C 1; E", "MF315", "deletes"),
        (f"{HEAD}{SQUARE}; DF; 0 other.cif; C 1; E", "MF315", "user extension"),
        (f"{HEAD}P 0 0 10 10 10 0 0 10; DF; C 1; E", "MF312", "crosses"),
        ("A photograph; E", "MF304", "not a CIF"),
        ("0\nSECTION\n", "MF304", "not a CIF"),
    ],
)
def test_what_is_refused(tmp_path, text, code, said):
    error = refused(tmp_path, text)
    assert error.code == code
    assert said in str(error)


def test_a_damaged_line_is_named(tmp_path):
    assert "line 3" in refused(tmp_path, "DS 1;\nL L1;\nP 0 0 1;\nDF;\nE").what


def test_what_klayout_reads_otherwise_is_refused(tmp_path):
    """klayout takes the only call outside of symbols for unmoved."""
    path = written(tmp_path, f"{HEAD}{SQUARE}; DF; C 1 T 5 5; E")
    (_, top) = cif_content(path).cells
    assert top["references"][0][1] == (50, 50)
    assert refused(tmp_path, path.read_text()).code == "MF316"


def test_off_the_grid_is_rounded_and_told(tmp_path):
    layout = read_layout(written(tmp_path, "DS 1 1 40; L L1; P 0 0 4 0 4 5 0 5; DF; C 1; E"))
    assert region(layout, CLEAR).bbox() == db.Box(0, 0, 1, 1)
    assert rounding_nm(layout) == 0.25


def test_too_many_symbols_are_refused_before_anything_is_made_of_them(tmp_path):
    assert refused(tmp_path, "".join(f"DS {k}; DF; " for k in range(MOST_CELLS + 1)) + "E").code == "MF313"


def test_a_polygon_that_was_exchanged_or_left_out_is_a_difference(small_plate, tmp_path):
    write_cif(small_plate, tmp_path / "x.cif")
    text = (tmp_path / "x.cif").read_text()
    whole = region(read_layout(tmp_path / "x.cif"), CLEAR)
    first = text[text.index("P ") : text.index(";", text.index("P ")) + 1]
    for changed in ("", "P 0 0 1000 0 1000 1000 0 1000;"):
        edited = region(read_layout(written(tmp_path, text.replace(first, changed, 1))), CLEAR)
        assert not (edited ^ whole).is_empty()


steps = some.lists(
    some.one_of(
        some.tuples(some.just("T"), some.integers(-999, 999), some.integers(-999, 999)),
        some.sampled_from([("M X",), ("M Y",), ("R", 3, 0), ("R", 0, 1), ("R", -2, 0), ("R", 0, -7)]),
    ),
    max_size=6,
)


@settings(max_examples=40, deadline=None)
@given(turns=steps, scale=some.sampled_from([(1, 10), (1, 1), (5, 2)]))
def test_calls_do_to_a_symbol_what_their_steps_say(tmp_path_factory, turns, scale):
    call = " ".join(str(part) for step in turns for part in step)
    above, below = scale
    text = f"DS 1; L L1; P 0 0 9 0 2 5; DF; DS 2 {above} {below}; C 1 {call}; DF; C 2; E"
    path = written(tmp_path_factory.mktemp("cif"), text)
    corners = [(0, 0), (90, 0), (20, 50)]
    for step in turns:
        if step[0] == "T":
            moved = [value * 10 * above // below for value in step[1:]]
            corners = [(x + moved[0], y + moved[1]) for x, y in corners]
        elif step[0] == "M X":
            corners = [(-x, y) for x, y in corners]
        elif step[0] == "M Y":
            corners = [(x, -y) for x, y in corners]
        else:
            along = complex(*step[1:]) / abs(complex(*step[1:]))
            turned = [complex(x, y) * along for x, y in corners]
            corners = [(round(each.real), round(each.imag)) for each in turned]
    expected = db.Region(db.Polygon([db.Point(x, y) for x, y in corners]))
    assert (region(read_layout(path), CLEAR) ^ expected).is_empty()
