from __future__ import annotations

import hashlib
import re
from dataclasses import replace

import pytest
from gerbonara.rs274x import GerberFile
from klayout import db

from maskfab.base.errors import OutputError
from maskfab.base.model import CLEAR
from maskfab.mask.figures import PolygonOptions, draw
from maskfab.mask.formats.gerber import gerber_bytes, write_gerber
from maskfab.mask.layout import plate_layout, region


def read(path):
    """What gerbonara takes for dark, in nanometres."""
    dark = db.Region()
    file = GerberFile.open(path)
    for each in file.objects:
        outline = db.Region(db.Polygon([db.Point(round(x * 1e6), round(y * 1e6)) for x, y in each.outline]))
        if each.polarity_dark:
            dark += outline
        else:
            dark -= outline
    return dark.merged()


@pytest.mark.parametrize(
    "options",
    [
        PolygonOptions(),
        PolygonOptions(hierarchy="merged"),
        PolygonOptions(holes="layer"),
        PolygonOptions(holes="keyhole", corners="joined"),
        PolygonOptions(max_references=19),
    ],
    ids=str,
)
def test_an_independent_reader_finds_the_design(small_plate, tmp_path, options):
    path = tmp_path / "x.gbr"
    write_gerber(draw(small_plate, options), path)
    assert (read(path) ^ region(plate_layout(small_plate), CLEAR)).is_empty()


@pytest.fixture
def text(small_plate, tmp_path):
    path = tmp_path / "x.gbr"
    plate = replace(small_plate, name="a,b*c%d\\µ")
    write_gerber(plate, path, ["job 0123, seeds a=1", "M02*\n%FSLAX24Y24*%", " #@! TF.FilePolarity,Negative"])
    return path.read_text(encoding="ascii")


def test_attributes_are_those_of_the_specification(text):
    found = dict(re.findall(r"^G04 #@! TF(\.[A-Za-z0-9]+),(.*)\*$", text, re.MULTILINE))
    assert set(found) == {".GenerationSoftware", ".Part", ".FileFunction", ".MD5"}
    assert found[".FileFunction"] == "Other,Photomask"
    assert found[".Part"] == "Other,Photomask a_b_c_d__"
    assert found[".GenerationSoftware"].startswith("maskfab,maskfab,")


def test_the_hash_is_of_all_before_it_without_line_ends(text):
    before, _, after = text.partition("G04 #@! TF.MD5,")
    assert after.split("*")[0] == hashlib.md5(before.replace("\n", "").encode()).hexdigest()
    assert after.endswith("*\nM02*\n")


def test_a_comment_cannot_end_the_file(text):
    assert text.count("M02*") == 1
    assert text.count("%FSLA") == 1
    assert "G04 job 0123, seeds a=1*" in text
    assert any(line.startswith("G04 Digitized data is clear") for line in text.splitlines())


def test_one_region_for_each_polygon_each_closed(text, small_plate):
    assert text.count("G36*") == text.count("G37*") == text.count("D02*") == draw(small_plate).account.polygons


def test_a_file_is_no_larger_than_told_and_refused_before_it_is_begun(small_plate, tmp_path):
    write_gerber(small_plate, tmp_path / "x.gbr")
    assert (tmp_path / "x.gbr").stat().st_size <= gerber_bytes(draw(small_plate))
    (tmp_path / "x.gbr").unlink()
    with pytest.raises(OutputError, match="MF415"):
        write_gerber(small_plate, tmp_path / "x.gbr", limit_bytes=1000)
    assert not list(tmp_path.iterdir())


def test_an_aperture_is_defined_and_never_taken(small_plate, tmp_path):
    """Readers warn of a file without one; regions are drawn with none."""
    write_gerber(draw(small_plate), tmp_path / "x.gbr")
    text = (tmp_path / "x.gbr").read_text(encoding="ascii")
    assert re.findall(r"%ADD(\d+)C,([\d.]+)\*%", text) == [("10", "0.001")]
    assert not re.search(r"D1\d\*", text.replace("%ADD10C,0.001*%", ""))
