"""Layouts that come with the program: what their searches find, and no layout that breaks a rule."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from keep_layouts import USERS, Recorder

from maskfab.base.resources import path
from maskfab.display import emitter_pieces, placement
from maskfab.display.feasibility import display_rules, feasibility
from maskfab.display.kept_layouts import FILE, KeptLayouts, origin_of, shipped
from maskfab.mask.job import load_job
from maskfab.report.documents.display import display_document, display_lines


@pytest.fixture(scope="module")
def asked():
    """Panel and rules of a die with emitters in pieces and wires across it."""
    job = load_job(path("layouts/first_plate.toml"))
    (die,) = (die for die in job.plate().dies if die.name == "OURS")
    return die.panel, display_rules(job)


@pytest.fixture
def taking(monkeypatch):
    """Lets every search ask some layouts first."""

    def take(kept: KeptLayouts) -> None:
        for user in USERS:
            monkeypatch.setattr(f"maskfab.display.{user}.shipped", lambda: kept)
        emitter_pieces._placed.cache_clear()
        placement._footprint.cache_clear()

    yield take
    emitter_pieces._placed.cache_clear()
    placement._footprint.cache_clear()


def test_what_is_kept_of_a_die_is_what_searches_find(asked, taking):
    taking(shipped())
    taken = feasibility(*asked)
    assert taken.kept == ("largest emitters", "emitters drawn", "wires")
    assert display_document(taken)["kept"] == list(taken.kept)
    assert any("emitters drawn, wires: came with maskfab" in line for line in display_lines("OURS", taken, None))
    recorder = Recorder()
    taking(recorder)
    searched = feasibility(*asked)
    assert searched.kept == ()
    assert len(recorder.layouts) >= 3
    assert all(np.array_equal(found, shipped().layouts[origin]) for origin, found in recorder.layouts.items())
    assert np.array_equal(searched.emitters.labels, taken.emitters.labels)
    assert [lines.paths for lines in searched.wiring.laid] == [lines.paths for lines in taken.wiring.laid]
    assert (searched.broken, searched.wiring.broken) == ((), ()) == (taken.broken, taken.wiring.broken)


class SearchedError(Exception):
    pass


def moved(labels, colour, over) -> np.ndarray:
    """A cell more of a colour, the first of those that another covers, or none."""
    changed = labels.copy()
    y, x = np.argwhere(labels == over)[0]
    changed[y, x] = colour
    return changed


def lines_changed(corners, number, by) -> np.ndarray:
    changed = corners.copy()
    changed[changed[:, 0] == number] += by
    return changed


def backwards(corners) -> np.ndarray:
    return np.concatenate([corners[corners[:, 0] == 0][::-1], corners[corners[:, 0] > 0]])


LABELS = {
    "a cell of another colour": lambda labels: moved(labels, 2, 1),
    "a cell alone": lambda labels: moved(labels, 3, 0),
    "over the opening": np.ones_like,
    "a colour lost": lambda labels: np.where(labels == 3, 0, labels),
    "no colours": lambda labels: labels + 10,
    "of another pixel": lambda labels: labels[:-1, :-1],
    "of another type": lambda labels: labels.astype(np.int64),
}
LINES = {
    "a line beside its place": lambda corners: lines_changed(corners, 0, (0, 0, 2500)),
    "a line in another pixel": lambda corners: lines_changed(corners, 0, (0, 0, -400_000)),
    "a line lost": lambda corners: corners[corners[:, 0] != 5] - (corners[corners[:, 0] != 5][:, :1] > 5) * (1, 0, 0),
    "a line too short": lambda corners: corners[1:],
    "a line that turns back": backwards,
    "no corners": lambda corners: corners[:0],
    "not of lines": lambda corners: corners[:, :2],
}


def tampered(change, kind) -> KeptLayouts:
    """Everything that ships, with a change to all layouts of a type."""
    shown = shipped().layouts
    return KeptLayouts({origin: change(kept) if kept.dtype == kind else kept for origin, kept in shown.items()})


@pytest.mark.parametrize("change", LABELS.values(), ids=LABELS)
@pytest.mark.parametrize("search", ["placement.polish", "emitter_pieces._Annealing.run"])
def test_emitters_that_break_a_rule_are_searched_for(asked, taking, change, search):
    with mock.patch(f"maskfab.display.{search}", side_effect=SearchedError):
        taking(shipped())
        feasibility(*asked)
        taking(tampered(change, "int8"))
        with mock.patch("maskfab.display.placement._crooked", wraps=placement._crooked) as crooked:
            if "polish" not in search:
                crooked.side_effect = lambda region, grid, ratio, start, *_: (0.0, start, False)
            with pytest.raises(SearchedError):
                feasibility(*asked)


@pytest.mark.parametrize("change", LINES.values(), ids=LINES)
def test_wires_that_break_a_rule_are_searched_for(asked, taking, change):
    with mock.patch("maskfab.display.wiring.panel_cut", side_effect=SearchedError):
        taking(shipped())
        feasibility(*asked)
        taking(tampered(change, "int64"))
        with pytest.raises(SearchedError):
            feasibility(*asked)


def test_a_damaged_file_keeps_nothing(tmp_path):
    whole = FILE.read_bytes()
    assert shipped().layouts
    for name, content in {
        "short": whole[:-30],
        "none": b"",
        "other": b"{}",
        "changed": whole[:90] + b"\0" + whole[91:],
        "packed otherwise": whole[: whole.index(b"PK\1\2") + 10] + b"\7" + whole[whole.index(b"PK\1\2") + 11 :],
    }.items():
        (tmp_path / name).write_bytes(content)
        assert shipped(tmp_path / name) == KeptLayouts()
    assert shipped(tmp_path / "not there") == KeptLayouts()


def test_every_input_of_a_search_counts():
    given = [(1, 2.0), (1, 2), (1.0, 2), (np.zeros(2), 1), (np.zeros(2, np.int8), 1), (np.zeros((1, 2)), 1), ("1", 2)]
    origins = {origin_of(name, version, *each) for each in given for name in ("a", "b") for version in (1, 2)}
    assert len(origins) == 4 * len(given)
