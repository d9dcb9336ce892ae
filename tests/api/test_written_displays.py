"""A plate with a display, written by Python: the file of a run, byte for byte, and one without it told by verify."""

from __future__ import annotations

import pytest
from klayout import db

import maskfab as mf

RULES = {
    "emitters": {"colour_gap": "8 um", "min_width": "8 um"},
    "wires": {"line": "3 um", "space": "3 um", "lines": 1},
}


@pytest.fixture(scope="module")
def plate():
    bar = mf.Opening.bar(dots=21, size=(9, 5), pitch="168 um")
    panel = mf.Panel.tile(bar, "random", seed=1, size="0.6 mm")
    camera = mf.Camera("5 mm", stop="0.4 mm", pixel="2 um", wavelengths=["530 nm"])
    return mf.Plate.of(BAR=panel, template="5in", camera=camera, sections=RULES)


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_a_plate_with_a_display_is_written_as_a_run_writes_it(plate, tmp_path):
    written = plate.write(tmp_path / "own.oas")
    mf.run(plate, out=tmp_path / "run")
    (of_run,) = (tmp_path / "run").glob("*.oas")
    assert written.read_bytes() == of_run.read_bytes()


def test_a_file_that_lost_the_display_fails(plate, tmp_path):
    whole = plate.write(tmp_path / "own.gds")
    assert mf.verify(whole, against=plate).passed
    layout = db.Layout()
    layout.read(str(whole))
    for number in (20, 30):
        layout.delete_layer(layout.find_layer(db.LayerInfo(number, 0)))
    layout.write(str(tmp_path / "less.gds"))
    answer = mf.verify(tmp_path / "less.gds", against=plate)
    assert not answer.passed
    assert any("RED, WIRE1" in row.method for row in answer if row.passed is False)
