"""Templates of plates: those that come with maskfab, and files that cannot be used."""

from __future__ import annotations

import pytest

from maskfab.base import resources
from maskfab.base.errors import JobError, catalogue
from maskfab.mask.marks import load_template, overlap, plate_template, template_names

TEXT = resources.path("export_templates/plates/5in.toml").read_text(encoding="utf-8")


def refused(call) -> JobError:
    with pytest.raises(JobError) as caught:
        call()
    assert caught.value.code in catalogue()
    return caught.value


def test_the_four_sizes_are_there():
    assert template_names() == ("4in", "5in", "6in", "7in")


@pytest.mark.parametrize("name", template_names())
def test_every_template_has_all_marks_in_rooms_apart(name):
    template = plate_template(name)
    assert template.blank == 25_400 * int(name[0])
    assert 0 < template.thickness < template.writable < template.blank
    kinds = {mark.kind for mark in template.mark}
    assert kinds == {
        "fiducial", "alignment", "parity", "title", "data_matrix", "die_map", "cd_bars", "line_space", "siemens_star",
        "checkerboard", "corners",
    }  # fmt: skip
    half = template.writable_nm // 2
    for number, mark in enumerate(template.mark):
        x0, y0, x1, y1 = mark.room_nm
        assert -half <= x0 < x1 <= half
        assert -half <= y0 < y1 <= half
        assert not any(overlap(mark.room_nm, other.room_nm) for other in template.mark[:number])


@pytest.mark.parametrize("name", template_names())
def test_every_template_leaves_a_square_for_dies(name):
    template = plate_template(name)
    keep = template.writable_nm // 2 - (10_000_000 if name == "4in" else 14_000_000)
    assert not any(overlap(mark.room_nm, (-keep, -keep, keep, keep)) for mark in template.mark)


def test_a_name_that_is_unknown_is_told_with_those_that_are():
    error = refused(lambda: plate_template("9in", where="job.toml: plate.template"))
    assert error.code == "MF125"
    assert "4in, 5in, 6in, 7in" in error.what
    assert error.where == "job.toml: plate.template"


@pytest.mark.parametrize("name", ["", "../plates/5in", "5in.toml", "/etc/passwd", "5IN"])
def test_a_name_is_no_path(name):
    assert refused(lambda: plate_template(name)).code == "MF125"


BAD = {
    "no TOML": ("[[mark]]", "[[mark", "", "TOML"),
    "unknown key": ("thickness =", "thickness_of_glass =", "thickness_of_glass", "unknown key"),
    "no blank": ('blank = "5 in"', "", "blank", "missing"),
    "unit": ('blank = "5 in"', 'blank = "5"', "blank", "no unit"),
    "not finite": ('blank = "5 in"', 'blank = "inf mm"', "blank", "finite"),
    "negative": ('thickness = "90 mil"', 'thickness = "-90 mil"', "thickness", "positive"),
    "wrong type": ('writable = "100 mm"', "writable = 100", "writable", "no unit"),
    "writable beyond blank": ('writable = "100 mm"', 'writable = "128 mm"', "writable", "wider than the blank"),
    "off the grid": ('writable = "100 mm"', 'writable = "99999.9995 um"', "writable", "1 nm"),
    "mark off the grid": ('length = "3 mm"', 'length = "2999.9995 um"', "mark[5].length", "1 nm"),
    "place off the grid": ('at = ["-47 mm"', 'at = ["-47000.0005 um"', "mark[5].at", "1 nm"),
    "place beyond": ('at = ["-47 mm"', 'at = ["-49 mm"', "mark[5].at", "1000 um"),
    "place without a side": ('at = ["-47 mm", "0 mm"]', 'at = ["-47 mm"]', "mark[5].alignment.at", ""),
    "unknown kind": ('kind = "alignment"', 'kind = "pentagram"', "mark[5]", "pentagram"),
    "key of another kind": ('kind = "alignment"', 'kind = "parity"', "mark[5]", "unknown key"),
    "rooms that overlap": ('at = ["-47 mm", "0 mm"]', 'at = ["-47 mm", "46 mm"]', "mark[5].at", "overlap"),
    "one name twice": ('name = "ALIGN_E"', 'name = "ALIGN_W"', "mark", "2 marks have the name 'ALIGN_W'"),
    "bad name": ('name = "ALIGN_E"', 'name = "ALIGN E"', "mark[6].alignment.name", "'ALIGN E'"),
    "small modules": ('module = "200 um"', 'module = "199 um"', "data_matrix.module", "200 um"),
    "line as broad as an arm": ('line = "40 um"', 'line = "376 um"', "mark[5].line", "8th of the length, 375 um"),
    "frame as broad as a map": (
        'room = ["11.5 mm", "11.5 mm"]\nline = "50 um"',
        'room = ["11.5 mm", "11.5 mm"]\nline = "231 um"',
        "mark[7].line",
        "230 um",
    ),
    "odd spokes": ("spokes = 36", "spokes = 37", "siemens_star.spokes", "multiple of 4"),
    "odd board": ("squares = 10", "squares = 9", "checkerboard.squares", "multiple of 2"),
    "no multiples": ("multiples = [1, 2]", "multiples = []", "checkerboard.multiples", ""),
    "multiple below the feature": ("multiples = [1, 2]", "multiples = [0.5]", "checkerboard.multiples", "0.5"),
    "multiple that is none": ("multiples = [1, 2]", "multiples = [nan]", "checkerboard.multiples", "nan"),
    "too many lines": ("lines = 5", "lines = 5000", "line_space.lines", "5000"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_template_is_refused_with_its_key(tmp_path, case):
    old, new, key, said = BAD[case]
    assert old in TEXT
    path = tmp_path / "bad.toml"
    path.write_text(TEXT.replace(old, new, 1), encoding="utf-8")
    error = refused(lambda: load_template(path))
    assert {fault.code for fault in error.faults} == {"MF124"}
    assert str(path) in error.where
    assert any(key in fault.where and said in fault.what and fault.cure for fault in error.faults)


def test_bytes_that_are_no_text_are_refused(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_bytes(b"summary = \xff\xfe")
    assert refused(lambda: load_template(path)).code == "MF124"
