"""The drawing of a plate: what is written on it stays on the sheet."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from maskfab.mask.package.papers import drawing_sheet

LONGEST = 90
"""Letters of the title block's type that fit beside the plate."""


def lines(svg: bytes) -> list[str]:
    return ["".join(text.itertext()) for text in ElementTree.fromstring(svg).iter("{http://www.w3.org/2000/svg}text")]


def test_a_long_note_is_broken_and_nothing_of_it_is_lost(small_plate):
    seeds = ",".join(f"DIE_NUMBER_{n}={n}" for n in range(30))
    signature = f"maskfab 0.1.0 | job 0123456789abcdef | seeds {seeds}"
    drawn = lines(drawing_sheet(small_plate, "svg", (signature, "x" * 300)))
    assert max(map(len, drawn)) <= LONGEST
    words = re.sub(r"\s", "", "".join(drawn))
    assert re.sub(r"\s", "", signature) in words
    assert "x" * 300 in words


def test_equal_plates_are_equal_bytes(small_plate):
    for kind in ("svg", "pdf"):
        assert drawing_sheet(small_plate, kind, ("a",)) == drawing_sheet(small_plate, kind, ("a",))
    assert drawing_sheet(small_plate, "svg", ("a",)) != drawing_sheet(small_plate, "svg", ("b",))
