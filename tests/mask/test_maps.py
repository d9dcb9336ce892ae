"""Orientation maps: their files, their place on a panel, and the jobs that name them."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from small_job import JOB, MASK, OPENING, command

from maskfab.base.errors import InputError, JobError
from maskfab.base.model import Opening, Tiling
from maskfab.mask import panels
from maskfab.mask.job import load_job
from maskfab.mask.panels import CellMap, panel_shape, placed, shifted, shifted_openings
from maskfab.optics.tiling import orientations

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")

TEXT = 'name = "four"\nmap = """\n0123\n4567\n"""\n'
EVEN = CellMap("even", np.arange(24).reshape(4, 6) % 8)


@given(
    cells=arrays(np.int8, array_shapes(min_dims=2, max_dims=2, max_side=9), elements=st.integers(0, 119)),
    author=st.text(max_size=20),
    moved=st.lists(st.tuples(st.integers(-20, 20), st.integers(-20, 20)), min_size=15, max_size=15) | st.just([]),
    beyond=st.none() | st.integers(0, 119),
)
def test_what_is_written_reads_back(cells, author, moved, beyond):
    written = CellMap("any", cells, {"author": author, "seed": 3, "share of light": 0.25}, tuple(moved), beyond)
    read = panels.parse_map(panels.map_text(written))
    assert (read.shifts, read.beyond) == (written.shifts, beyond)
    assert np.array_equal(read.cells, cells)
    assert (read.name, dict(read.provenance)) == (written.name, dict(written.provenance))


def test_round_a_map_lies_what_it_says_whatever_the_seed():
    regular = CellMap("regular", EVEN.cells, beyond=11)
    for seed in (0, 7, None):
        laid = placed(regular, 8, 10, seed, openings=2, where="die")
        assert np.array_equal(laid[2:6, 2:8], EVEN.cells)
        laid[2:6, 2:8] = 11
        assert (laid == 11).all()
    with pytest.raises(JobError, match=r"MF122.*opening 1, counted from 0"):
        placed(regular, 8, 10, 0, openings=1, where="die")


def test_the_top_row_is_written_first():
    assert panels.parse_map(TEXT).cells.tolist() == [[4, 5, 6, 7], [0, 1, 2, 3]]


def test_the_second_drawing_says_which_opening():
    text = TEXT + 'openings = """\n000e\n1000\n"""\n'
    assert panels.parse_map(text).cells.tolist() == [[12, 5, 6, 7], [0, 1, 2, 115]]


@pytest.mark.parametrize(
    ("text", "code", "place"),
    [
        ("name = ", "MF101", ""),
        (TEXT + "turns = 3\n", "MF102", "turns"),
        ('map = "0"', "MF105", "name"),
        ('name = "four"', "MF105", "map"),
        ('name = "four"\nmap = 3', "MF105", "map"),
        ('name = "4"\nmap = "0"', "MF110", "name"),
        ('name = "four"\nmap = ""', "MF122", "0 rows"),
        (TEXT.replace("6", "8"), "MF122", "line 2, column 3"),
        (TEXT.replace("456", "45"), "MF122", "line 2 has 3 cells"),
        (TEXT + 'openings = "0000"', "MF122", "1 rows of 4 openings"),
        (TEXT + 'openings = """\n000f\n0000"""', "MF122", "line 1, column 4"),
        (f'name = "wide"\nmap = "{"0" * 1001}"', "MF115", "1001"),
        (TEXT + "beyond = 3", "MF105", "beyond"),
        (TEXT + "beyond = [0, true]", "MF105", "beyond"),
        (TEXT + "beyond = [0, 8]", "MF122", "element of 0 to 7"),
        (TEXT + "beyond = [15, 0]", "MF122", "opening of 0 to 14"),
        (TEXT + "shifts = [[0, 0]]\nbeyond = [1, 0]", "MF122", "opening 1"),
        (TEXT + "shifts = 3", "MF105", "shifts"),
        (TEXT + "shifts = [[0, 0, 0]]", "MF105", "shifts"),
        (TEXT + "shifts = [[0, 0.5]]", "MF105", "shifts"),
        (TEXT + "shifts = [[0, true]]", "MF105", "shifts"),
        (TEXT + f"shifts = {[[0, 0]] * 16}", "MF122", "16 shifts"),
        (TEXT + 'openings = """\n0002\n0000"""\nshifts = [[0, 0], [1, 0]]', "MF122", "opening 2"),
        (TEXT + "provenance = 3", "MF105", "provenance"),
        (TEXT + "[provenance]\nmade = true", "MF105", "provenance.made"),
    ],
)
def test_a_bad_map_is_told_with_its_place(text, code, place):
    with pytest.raises(JobError, match=code) as told:
        panels.parse_map(text, "map.toml")
    assert place in str(told.value)
    assert "map.toml" in str(told.value)


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("none.toml", None, "MF301"),
        ("map.txt", b"0123", "MF308"),
        ("map.toml", b" \n", "MF302"),
        ("map.toml", b"\xff\xfe", "MF304"),
    ],
)
def test_a_file_that_is_no_map_is_told(tmp_path, name, content, code):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=code):
        panels.read_map(tmp_path / name)


@pytest.mark.parametrize(("rows", "columns"), [(4, 6), (8, 12), (10, 8)])
def test_the_middle_of_the_map_is_that_of_the_panel(rows, columns):
    panel = placed(EVEN, rows, columns, 3, openings=1, where="")
    low, left = (rows - 4) // 2, (columns - 6) // 2
    assert np.array_equal(panel[low : low + 4, left : left + 6], EVEN.cells)
    beyond = np.ones(panel.shape, dtype=np.bool_)
    beyond[low : low + 4, left : left + 6] = False
    drawn = orientations(Tiling.RANDOM, rows, columns, 3)
    assert np.array_equal(panel[beyond], drawn[beyond])


def test_a_smaller_panel_holds_the_middle_of_the_map():
    assert np.array_equal(placed(EVEN, 2, 2, 3, openings=1, where=""), EVEN.cells[1:3, 2:4])


@given(rows=st.integers(1, 40), columns=st.integers(1, 40), high=st.integers(1, 9), wide=st.integers(1, 9))
def test_a_panel_loses_one_cell_at_most_for_its_map(rows, columns, high, wide):
    shape = panel_shape(CellMap("any", np.zeros((high, wide))), rows, columns)
    assert (shape[0] - high) % 2 == (shape[1] - wide) % 2 == 0
    assert shape[0] in (rows, rows - 1)
    assert shape[1] in (columns, columns - 1)


def test_a_map_whose_middle_cannot_lie_on_the_axis_is_refused():
    with pytest.raises(JobError, match=r"MF122.*4 rows and the panel 5"):
        placed(EVEN, 5, 6, 1, openings=1, where="die")


def test_openings_that_the_die_has_not_are_refused():
    cells = CellMap("two", np.array([[0, 15]]))
    with pytest.raises(JobError, match=r"MF122.*opening 1.*has 1"):
        placed(cells, 3, 4, 1, openings=1, where="die")
    assert set(placed(cells, 21, 40, 1, openings=2, where="die").ravel().tolist()) == set(range(16))


def test_what_is_beyond_needs_a_seed():
    with pytest.raises(JobError, match="MF111"):
        placed(EVEN, 6, 6, None, openings=1, where="die")


def test_no_other_command_draws_a_map():
    with pytest.raises(JobError, match="MF122"):
        orientations(Tiling.MAP, 4, 4, 1)


def mapped(tmp_path, text=TEXT, extra='map = "maps/four.toml"', tiling="map"):
    """The small job with its second die tiled by a map."""
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "four.toml").write_text(text, encoding="utf-8")
    (tmp_path / "ring.toml").write_text(OPENING, encoding="utf-8")
    job = tmp_path / "job.toml"
    job.write_text(JOB.replace('tiling = "random"', f'tiling = "{tiling}"\n{extra}'), encoding="utf-8")
    return job


def test_a_job_is_self_contained_with_its_map(tmp_path):
    job = load_job(mapped(tmp_path))
    panel = job.plate().dies[1].panel
    assert panel.tiling is Tiling.MAP
    assert not panel.tiling.independent
    assert panel.orientations.shape == (10, 10)
    assert panel.orientations[4:6, 3:7].tolist() == [[4, 5, 6, 7], [0, 1, 2, 3]]
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    copy = elsewhere / "job.json"
    copy.write_text(json.dumps(job.spec.dump()), encoding="utf-8")
    again = load_job(copy)
    assert again.digest == job.digest
    assert np.array_equal(again.plate().dies[1].panel.orientations, panel.orientations)


def test_a_die_stays_centred_on_a_map_of_odd_sides(tmp_path):
    die = load_job(mapped(tmp_path, 'name = "odd"\nmap = """\n7\n"""')).plate().dies[1]
    assert die.panel.orientations.shape == (9, 9)
    assert die.panel.orientations[4, 4] == 7
    x0, y0, x1, y1 = die.box_nm
    assert ((x0 + x1) // 2, (y0 + y1) // 2) == die.centre_nm


def test_the_map_is_part_of_the_job_s_hash_and_its_absence_is_not(tmp_path):
    one = load_job(mapped(tmp_path))
    (tmp_path / "maps" / "four.toml").write_text(TEXT.replace("7", "0"), encoding="utf-8")
    assert load_job(tmp_path / "job.toml").digest != one.digest
    (tmp_path / "job.toml").write_text(JOB, encoding="utf-8")
    dumped = load_job(tmp_path / "job.toml").spec.dump()
    assert "maps" not in dumped
    assert all("map" not in die for die in dumped["die"])


@pytest.mark.parametrize(("extra", "tiling"), [("", "map"), ('map = "maps/four.toml"', "random")])
def test_a_map_and_its_tiling_go_together(tmp_path, extra, tiling):
    with pytest.raises(JobError, match=r"MF122.*die\[1\]\.map"):
        load_job(mapped(tmp_path, extra=extra, tiling=tiling))


def test_two_maps_of_one_name_are_refused(tmp_path):
    job = mapped(tmp_path)
    (tmp_path / "maps" / "other.toml").write_text(TEXT.replace("7", "0"), encoding="utf-8")
    plain, mapped_die = 'tiling = "periodic"', 'tiling = "map"\nmap = "maps/other.toml"\nseed = 1'
    job.write_text(job.read_text(encoding="utf-8").replace(plain, mapped_die), encoding="utf-8")
    with pytest.raises(JobError, match="MF109"):
        load_job(job)


MOVED = TEXT + 'openings = """\n0120\n0000\n"""\nshifts = [[0, 0], [1, 0], [-1, 1]]\n'


def test_the_ring_s_place_moves_right_and_up():
    assert np.array_equal(shifted(MASK, (1, 0)), np.roll(MASK, 1, axis=1))
    assert np.array_equal(shifted(MASK, (-1, 1)), np.roll(MASK, (1, -1), axis=(0, 1)))


@given(right=st.integers(-9, 9), up=st.integers(-9, 9))
def test_what_is_moved_out_does_not_come_in_again(right, up):
    full = np.ones((7, 7), dtype=np.bool_)
    assert shifted(full, (right, up)).sum() == max(0, 7 - abs(right)) * max(0, 7 - abs(up))
    back = shifted(shifted(MASK, (right, up)), (-right, -up))
    assert not (back & ~MASK).any()


def test_a_die_has_the_openings_that_its_map_moves(tmp_path):
    job = load_job(mapped(tmp_path, MOVED))
    panel = job.plate().dies[1].panel
    assert [opening.name for opening in panel.openings] == ["ring", "ring_1", "ring_2"]
    assert np.array_equal(panel.pattern(8), np.roll(MASK, 1, axis=1))
    assert panel.orientations[4:6, 3:7].tolist() == [[4, 5, 6, 7], [0, 9, 18, 3]]
    assert [opening.clear_dots for opening in panel.openings] == [MASK.sum()] * 3
    assert list(job.spec.openings) == ["ring"]
    copy = tmp_path / "copy.json"
    copy.write_text(json.dumps(job.spec.dump()), encoding="utf-8")
    again = load_job(copy)
    assert again.digest == job.digest
    assert np.array_equal(again.plate().dies[1].panel.patterns, panel.patterns)


def test_a_plate_with_moved_openings_runs_and_verifies(tmp_path, capsys):
    out, job = tmp_path / "out", mapped(tmp_path, MOVED)
    job.write_text(job.read_text(encoding="utf-8") + '\n[export]\nformats = ["gdsii", "oasis"]\n', encoding="utf-8")
    assert command(capsys, "run", job, "--out", out, "--quiet").code == 0
    assert command(capsys, "verify", out, "--quiet").code == 0


def test_a_shift_is_part_of_the_job_s_hash(tmp_path):
    one = load_job(mapped(tmp_path, MOVED))
    (tmp_path / "maps" / "four.toml").write_text(MOVED.replace("[-1, 1]", "[-1, 0]"), encoding="utf-8")
    assert load_job(tmp_path / "job.toml").digest != one.digest


@pytest.mark.parametrize(
    ("shifts", "held", "code", "said"),
    [
        (((0, 0), (2, 0)), (Opening("ring", MASK, 8000),), "MF122", "clear dots of 'ring' out of the cell"),
        (((0, 0), (1, 0)), (Opening("ring", MASK, 8000),) * 2, "MF122", "others"),
        (((1, 0),), (Opening("ring", MASK, 8000, emitters=np.zeros((7, 7))),), "MF119", "emitters"),
    ],
)
def test_openings_that_cannot_be_moved_are_told(shifts, held, code, said):
    cells = CellMap("four", np.zeros((2, 2)), shifts=shifts)
    with pytest.raises(JobError, match=code) as told:
        shifted_openings(cells, held, where="die")
    assert said in str(told.value)


def test_a_long_name_stays_short_enough_for_its_file():
    cells = CellMap("four", np.zeros((2, 2)), shifts=((0, 0), (1, 0)))
    _, other = shifted_openings(cells, (Opening("r" * 24, MASK, 8000),), where="die")
    assert other.name == "r" * 22 + "_1"


def test_emitters_that_do_not_move_may_stay():
    drawn = Opening("ring", MASK, 8000, emitters=np.zeros((7, 7)))
    assert shifted_openings(CellMap("four", np.zeros((2, 2)), shifts=((0, 0),)), (drawn,), where="die") == (drawn,)
