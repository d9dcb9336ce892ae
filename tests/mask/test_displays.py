"""Layouts of displays: what is claimed of their symmetry, their areas and their gaps, and what they refuse."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import ndimage
from small_job import command

import maskfab
from maskfab.base.errors import JobError
from maskfab.base.model import Opening, Tiling, orient
from maskfab.base.units import parse_pitch_um
from maskfab.cli.command import command_of
from maskfab.mask import job, opening_file
from maskfab.mask import opening_masks as given_emitters
from maskfab.mask.emitter_layouts import (
    BLUE,
    DISPLAYS,
    GREEN,
    RED,
    band,
    circular,
    delta,
    diamond,
    read_lengths,
    source_facts,
)

LAYOUTS = Path(__file__).parents[2] / "layouts"
KINDS = tuple(DISPLAYS)
FILES = {kind: f"{kind.replace('-', '_')}.toml" for kind in KINDS} | {"pentile-lines": "poled.toml"}
PPI, OPEN, EMITTING = (
    dict(zip(KINDS, values, strict=True))
    for values in (
        (300, 402, 302.4, 300, 326, 58),
        (0.2154, 0.2540, 0.2370, 0.2653, 0.2005, 0.7074),
        (0.2857, 0.2472, 0.3787, 0.2653, 0.2002, 0.1300),
    )
)
DIAMONDS = ("pentile-diamond", "pentile-lines")


def shipped(kind: str) -> Opening:
    return opening_file.load_opening(LAYOUTS / "openings" / FILES[kind])


def apart(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> int:
    """Least gap in cells between two patterns that repeat, along x or along y, whichever is larger."""
    here, there = (np.pad(each, each.shape[0] // 2, mode="wrap") for each in (one, other))
    return int(ndimage.distance_transform_cdt(~here, "chessboard")[there].min()) - 1


def finer(opening: Opening) -> tuple[NDArray[np.bool_], NDArray[np.int8], float]:
    """Mask and labels on the cells of the labels, and a cell in micrometres."""
    labels = opening.emitters
    assert labels is not None
    times = labels.shape[0] // opening.dots
    return opening.mask.repeat(times, axis=0).repeat(times, axis=1), labels, opening.dot_nm / times / 1e3


# --- the files ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_its_command_byte_for_byte(capsys, monkeypatch, tmp_path, kind):
    path = LAYOUTS / "openings" / FILES[kind]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "layouts" / "openings").mkdir(parents=True)
    line = tomllib.loads(path.read_text(encoding="utf-8"))["provenance"]["command"]
    assert line == f"maskfab new layouts/openings/{path.name} --shape {kind}"
    assert command(capsys, *line.split()[1:]).code == 0
    assert (tmp_path / "layouts" / "openings" / path.name).read_bytes() == path.read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_pitch_and_areas_are_as_stated(kind):
    opening = shipped(kind)
    clear, labels, _ = finer(opening)
    pixel_um = opening.dots * opening.dot_nm / 1e3 / DISPLAYS[kind].pixels_across
    assert 25_400 / pixel_um == pytest.approx(PPI[kind], rel=0.01)
    assert opening.open_ratio == pytest.approx(OPEN[kind], abs=5e-5)
    assert (labels > 0).mean() == pytest.approx(EMITTING[kind], abs=5e-5)
    assert not clear[labels > 0].any()


@pytest.mark.parametrize("kind", KINDS)
def test_gaps_hold_across_cells(kind):
    clear, labels, cell_um = finer(shipped(kind))
    for one, other in ((RED, GREEN), (GREEN, BLUE), (RED, BLUE)):
        assert apart(labels == one, labels == other) * cell_um >= 8
    assert apart(labels > 0, clear) * cell_um >= 3


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind not in DIAMONDS])
def test_colours_have_equal_areas(kind):
    labels = finer(shipped(kind))[1]
    assert len({int((labels == label).sum()) for label in (RED, GREEN, BLUE)}) == 1


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "pentile-lines"])
def test_clear_and_emitting_features_are_whole(kind):
    """No speck: all clear pieces are alike within two dots, and so are all emitters of one colour."""
    clear, labels, _ = finer(shipped(kind))
    for pattern in (clear, *(labels == label for label in (RED, GREEN, BLUE))):
        tiled = np.tile(pattern, (3, 3))
        pieces, count = ndimage.label(tiled)
        cut = set(np.unique(np.concatenate([pieces[0], pieces[-1], pieces[:, 0], pieces[:, -1]])))
        areas = np.bincount(pieces.ravel())[[n for n in range(1, count + 1) if n not in cut]]
        assert areas.min() == areas.max()


# --- symmetry -------------------------------------------------------------------------------------------------------


def test_diamond_has_every_symmetry_of_a_square():
    opening = shipped("pentile-diamond")
    for k in range(8):
        assert np.array_equal(orient(opening.mask, k), opening.mask)
        assert opening.emitters is not None
        assert np.array_equal(orient(opening.emitters, k), opening.emitters)


@pytest.mark.parametrize("kind", DIAMONDS)
def test_blue_is_largest_and_green_smallest_in_a_diamond(kind):
    labels = finer(shipped(kind))[1]
    red, green, blue = (int((labels == label).sum()) for label in (RED, GREEN, BLUE))
    assert blue / 2 > red / 2 > green / 4


def test_a_diamond_is_a_lattice_turned_by_45_degrees():
    """Half a cell along x and y maps red on red and blue on blue; half a cell along x alone swaps their places."""
    labels = finer(shipped("pentile-diamond"))[1]
    half = labels.shape[0] // 2
    assert np.array_equal(np.roll(labels, (half, half), (0, 1)), labels)
    moved = np.roll(labels, half, 1)
    assert np.array_equal(moved == GREEN, labels == GREEN)
    assert labels[0, 0] == RED
    assert moved[0, 0] == BLUE


def test_lines_cross_every_pixel_and_the_cell_begins_where_they_meet():
    """Closed lines of 8 um: three up and two across each of two by two pixels; nothing clear is left out between."""
    opening = shipped("pentile-lines")
    lengths, pixel = DISPLAYS["pentile-lines"].lengths, opening.dots // 2
    near = ndimage.maximum_filter(opening.emitters, size=2 * lengths["to_opening"] + 1, mode="wrap") > 0
    closed = []
    for axis in (0, 1):
        free = np.any(opening.mask, axis=axis)
        assert np.array_equal(free[:pixel], free[pixel:])
        assert not free[: lengths["line_width"]].any()
        closed.append(~free)
    assert [int(lines.sum()) for lines in closed] == [2 * 3 * lengths["line_width"], 2 * 2 * lengths["line_width"]]
    assert np.array_equal(opening.mask, ~(near | closed[0][None, :] | closed[1][:, None]))


def test_no_turn_maps_a_cell_with_lines_on_itself():
    """Its lattice is that of a diamond, but the cell begins elsewhere: a random tiling is no periodic one."""
    opening = shipped("pentile-lines")
    assert all(not np.array_equal(orient(opening.mask, k), opening.mask) for k in range(1, 8))


def test_band_is_symmetric_from_left_to_right():
    for kind in ("rgb-stripe", "window"):
        clear, labels, _ = finer(shipped(kind))
        assert np.array_equal(clear, clear[:, ::-1])
        swapped = labels[:, ::-1]
        assert np.array_equal(swapped == GREEN, labels == GREEN)
        assert np.array_equal(swapped == RED, labels == BLUE)


def test_delta_repeats_every_pixel_upwards_and_every_two_along():
    opening = shipped("delta")
    labels, half = opening.emitters, opening.dots // 2
    assert labels is not None
    for pattern in (labels, opening.mask):
        assert np.array_equal(np.roll(pattern, half, 0), pattern)
        assert not np.array_equal(np.roll(pattern, half, 1), pattern)
        # One row up and one and a half sub-pixels along is the same lattice: that makes it a delta.
        assert np.array_equal(np.roll(pattern, (opening.dots // 4, half), (0, 1)), pattern)
    assert np.array_equal(opening.mask[::-1, ::-1], opening.mask)


def test_every_triangle_of_a_delta_has_three_colours():
    """Above the middle of two neighbours of a row is the third colour."""
    opening = shipped("delta")
    labels, dots = opening.emitters, opening.dots
    assert labels is not None
    middle, rise = dots // 8, dots // 4
    across = dots // 3
    for index in range(3):
        first = across // 4 + index * across
        triangle = {
            int(labels[middle, first]),
            int(labels[middle, (first + across) % dots]),
            int(labels[middle + rise, (first + across // 2) % dots]),
        }
        assert triangle == {RED, GREEN, BLUE}


def test_no_emitter_of_a_delta_is_cut_by_its_cell():
    labels = finer(shipped("delta"))[1]
    for edge in (labels[0], labels[-1], labels[:, 0], labels[:, -1]):
        assert not edge.any()


def test_circular_is_one_to_one_and_round():
    opening = shipped("circular")
    clear, labels, _ = finer(opening)
    assert (labels > 0).sum() == pytest.approx(clear.sum(), rel=0.01)
    for k in range(8):
        assert np.array_equal(orient(opening.mask, k), opening.mask)
    assert np.array_equal(labels[:, ::-1] == GREEN, labels == BLUE)
    assert np.array_equal(labels[:, ::-1] == RED, labels == RED)
    assert opening.clear_dots == pytest.approx(np.pi / 4 * DISPLAYS["circular"].lengths["diameter"] ** 2, rel=0.03)


# --- parameters -----------------------------------------------------------------------------------------------------


@given(
    dots=st.integers(2, 60),
    clear=st.tuples(st.integers(1, 60), st.integers(1, 60)),
    emitter=st.tuples(st.integers(1, 20), st.integers(1, 40)),
    gaps=st.tuples(st.integers(1, 10), st.integers(1, 10)),
)
def test_a_band_keeps_its_lengths_or_is_refused(dots, clear, emitter, gaps):
    try:
        mask, labels = band(
            dots,
            clear_width=clear[0],
            clear_height=clear[1],
            emitter_width=emitter[0],
            emitter_height=emitter[1],
            colour_gap=gaps[0],
            to_opening=gaps[1],
        )
    except JobError as refused:
        if refused.code != "MF117":
            raise
        return
    given_emitters.check_emitters(labels, mask, "")
    assert mask.sum() == clear[0] * clear[1]
    assert all((labels == label).sum() == emitter[0] * emitter[1] for label in (RED, GREEN, BLUE))
    assert apart(labels == RED, labels == GREEN) == gaps[0]
    assert apart(labels > 0, mask) >= gaps[1]


@settings(deadline=None)
@given(
    dots=st.integers(1, 5).map(lambda n: 12 * n),
    clear=st.tuples(st.integers(1, 12), st.integers(1, 12)),
    emitter=st.tuples(st.integers(1, 12), st.integers(1, 12)),
)
def test_a_delta_has_twelve_of_each_or_is_refused(dots, clear, emitter):
    try:
        mask, labels = delta(
            dots, clear_width=clear[0], clear_height=clear[1], emitter_width=emitter[0], emitter_height=emitter[1]
        )
    except JobError as refused:
        if refused.code != "MF117":
            raise
        return
    given_emitters.check_emitters(labels, mask, "")
    assert (labels > 0).sum() == 12 * emitter[0] * emitter[1]
    assert mask.sum() == 12 * clear[0] * clear[1]


@settings(deadline=None)
@given(
    dots=st.integers(8, 40).map(lambda n: 2 * n),
    clear=st.integers(1, 8),
    reaches=st.tuples(st.integers(1, 10), st.integers(1, 10), st.integers(1, 10)),
    gap=st.integers(1, 3),
)
def test_a_diamond_keeps_its_gap_and_symmetry_or_is_refused(dots, clear, reaches, gap):
    red, green, blue = reaches
    try:
        mask, labels = diamond(
            dots, clear_reach=clear, red_reach=red, green_reach=green, blue_reach=blue, to_opening=gap
        )
    except JobError as refused:
        if refused.code != "MF117":
            raise
        return
    assert all((labels == label).any() for label in (RED, GREEN, BLUE))
    assert apart(labels > 0, mask) >= gap
    for k in range(8):
        assert np.array_equal(orient(labels, k), labels)
        assert np.array_equal(orient(mask, k), mask)
    for one, other in ((RED, GREEN), (GREEN, BLUE), (RED, BLUE)):
        assert apart(labels == one, labels == other) >= 0
    # Neither is cut by another: middles on corners of dots leave a rhombus 2 r (r + 1) dots.
    assert (labels == RED).sum() == 4 * red * (red + 1)
    assert (labels == BLUE).sum() == 4 * blue * (blue + 1)


@settings(deadline=None)
@given(st.integers(20, 60), st.integers(4, 40), st.integers(1, 6), st.integers(1, 4), st.integers(1, 4))
def test_a_ring_keeps_its_gaps_or_is_refused(dots, diameter, colour_gap, to_opening, border):
    try:
        mask, labels = circular(dots, diameter=diameter, colour_gap=colour_gap, to_opening=to_opening, border=border)
    except JobError as refused:
        if refused.code != "MF117":
            raise
        return
    clear = mask.repeat(2, axis=0).repeat(2, axis=1)
    assert (labels > 0).sum() == pytest.approx(clear.sum(), rel=0.01, abs=24)
    assert apart(labels > 0, clear) >= 2 * to_opening
    for one, other in ((RED, GREEN), (GREEN, BLUE), (RED, BLUE)):
        gap = ndimage.distance_transform_cdt(labels != one, "chessboard")[labels == other].min() - 1
        assert gap >= 2 * colour_gap
    assert not labels[: 2 * border].any()
    assert not labels[:, : 2 * border].any()


@pytest.mark.parametrize(
    ("kind", "dots", "changed", "code"),
    [
        ("rgb-stripe", None, {"clear_height": 11}, "MF117"),
        ("rgb-stripe", None, {"clear_width": 43}, "MF117"),
        ("rgb-stripe", None, {"colour_gap": 0}, "MF104"),
        ("rgb-stripe", 0, {}, "MF104"),
        ("rgb-stripe", None, {"diameter": 4}, "MF102"),
        ("pentile-diamond", 41, {}, "MF104"),
        ("pentile-diamond", None, {"blue_reach": 16}, "MF117"),
        ("pentile-lines", 41, {}, "MF104"),
        ("pentile-lines", None, {"green_reach": 9}, "MF117"),
        ("pentile-lines", None, {"power": 13}, "MF117"),
        ("pentile-lines", None, {"to_opening": 9}, "MF117"),
        ("delta", 80, {}, "MF104"),
        ("delta", None, {"clear_width": 17}, "MF117"),
        ("circular", None, {"diameter": 22}, "MF117"),
        ("window", 5000, {}, "MF104"),
    ],
)
def test_bad_lengths_are_refused(kind, dots, changed, code):
    with pytest.raises(JobError) as refused:
        DISPLAYS[kind].draw(dots, changed)
    assert refused.value.code == code


def test_lengths_are_read_in_pairs():
    assert read_lengths(["diameter=20", " border = 3 "]) == {"diameter": 20, "border": 3}
    assert read_lengths([]) == {}
    for pairs, code in ((["diameter"], "MF105"), (["diameter=-2"], "MF105"), (["a=1", "a=2"], "MF102")):
        with pytest.raises(JobError) as refused:
            read_lengths(pairs)
        assert refused.value.code == code


# --- the verb -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        (("--pitch", "200 dpi", "--set", "opening=8"), r"MF102.*40 dots.*clear_reach=4, red_reach=5"),
        (("--set", "clear_reach=4.5"), "Write clear_reach=4 or clear_reach=5"),
        (("--pitch", "63.5 um", "--dots", "127"), "Use 100 dots of 0.635 um"),
    ],
)
def test_what_is_refused_of_a_display_says_what_to_write(capsys, tmp_path, asked, told):
    shown = command(capsys, "new", tmp_path / "drawn.toml", "--shape", "pentile-diamond", *asked)
    assert shown.code == 2
    assert re.search(told, shown.stderr)


def test_a_shape_makes_the_folders_above_its_file(capsys, tmp_path):
    assert command(capsys, "new", tmp_path / "a/b/drawn.toml", "--shape", "rgb-stripe").code == 0
    assert opening_file.load_opening(tmp_path / "a/b/drawn.toml").clear_dots


def test_a_cell_of_several_pixels_says_so(capsys, tmp_path):
    shown = command(capsys, "new", tmp_path / "drawn.toml", "--shape", "pentile-diamond", "--pitch", "200 dpi")
    assert "for 2 x 2 pixels of 63.5 um, 400 dpi" in shown.stdout


def test_the_verb_names_every_display():
    (shape,) = (each for each in command_of("new").options if each.name == "shape")
    assert all(kind in shape.help for kind in KINDS)


def test_a_changed_display_claims_no_source(capsys, tmp_path):
    target = tmp_path / "ring.toml"
    assert command(capsys, "new", target, "--shape", "circular", "--set", "diameter=16").code == 0
    found = opening_file.load_opening(target)
    assert "source" not in found.provenance
    assert found.provenance["judgement"]
    assert found.clear_dots < shipped("circular").clear_dots
    assert source_facts(DISPLAYS["circular"], changed=True).keys() == {"judgement"}


def test_the_verb_scales_a_display(capsys, tmp_path):
    target = tmp_path / "large.toml"
    assert command(capsys, "new", target, "--shape", "window", "--pitch", "511 um").code == 0
    found = opening_file.load_opening(target)
    assert found.dot_nm == 7000
    assert np.array_equal(found.mask, shipped("window").mask)


@pytest.mark.parametrize(
    "arguments",
    [("stripe", "--set", "diameter=3"), ("circular", "--set", "diameter=39"), ("delta", "--dots", "21")],
)
def test_the_verb_refuses_and_writes_nothing(capsys, tmp_path, arguments):
    target = tmp_path / "none.toml"
    assert command(capsys, "new", target, "--shape", *arguments).code == 2
    assert not target.exists()


# --- the job --------------------------------------------------------------------------------------------------------


def test_the_job_shows_every_display_and_tiling():
    found = job.load_job(LAYOUTS / "displays.toml")
    dies = found.spec.die
    # A map of orientations belongs to one opening that was designed for it.
    assert {die.tiling for die in dies} == set(Tiling) - {Tiling.MAP}
    assert sum(die.others is not None for die in dies) == 1
    drawn = {held[0].name for held in found.openings.values()}
    assert {Path(file).stem for file in FILES.values()} - {"poled"} <= drawn
    for die in found.plate().dies:
        assert min(die.panel.size_nm) >= found.camera.stop.diameter_um * 1e3
        assert max(die.panel.size_nm) <= die.slot_nm


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("pitch", ["140 um", "300 dpi", "63.5 um"])
def test_a_display_is_drawn_at_any_pitch_in_proportion(kind, pitch):
    """Of whole nanometres that make the pitch, or the nearest; as open as the display's own, but for whole dots."""
    drawn, own = maskfab.Opening.shape(kind, pitch=pitch), maskfab.Opening.shape(kind)
    assert drawn.pitch_um == pytest.approx(parse_pitch_um(pitch), rel=2e-4)
    assert pitch != "140 um" or kind == "delta" or drawn.pitch_um == 140.0
    assert drawn.open_ratio == pytest.approx(own.open_ratio, rel=0.4)


@pytest.mark.parametrize("dots", [16, 21, 40, 64])
def test_a_display_has_room_at_any_number_of_dots(dots):
    """56 dots were the first in which lengths stated for 42 had room and that divide 140 um."""
    drawn = maskfab.Opening.shape("rgb-stripe", dots=dots, pitch="140 um")
    assert (drawn.dots, drawn.emitters is not None) == (dots, True)
    assert drawn.pitch_um == pytest.approx(140, rel=5e-4)
