"""A kill at whatever system call costs nobody a result or a document, and the next start leaves nothing of it."""

from __future__ import annotations

import pytest
from kill_swaps import can_trace, chosen, counted, play
from swaps import swap, whole, write_result

from maskfab.base.errors import OutputError

traced = pytest.mark.skipif(not can_trace(), reason="no process may be traced here")


def played(tmp_path, chosen_of):
    calls = counted(tmp_path)
    rounds = [chosen(number, calls) for number in chosen_of(sum(calls.values()))]
    told = [play(tmp_path / "round", each) for each in rounds]
    assert sum(kills for kills, _ in told) > len(rounds) / 2
    return [(each, wrong) for each, (_, wrong) in zip(rounds, told, strict=True) if wrong]


@traced
def test_killed_at_a_system_call_nothing_is_lost_and_the_next_start_leaves_nothing(tmp_path):
    assert played(tmp_path, lambda total: [*range(0, total, 167), *range(total, total + 15)]) == []


@traced
@pytest.mark.slow
def test_killed_at_every_system_call_and_while_somebody_writes_nothing_is_lost(tmp_path):
    assert played(tmp_path, lambda total: range(total + 600)) == []


@pytest.mark.parametrize("half", ["manifest.json", "timing.json"])
def test_a_result_whose_last_files_were_half_written_is_swept(tmp_path, half):
    """Though it says nothing, or something wrong, of what is its own."""
    left = tmp_path / ".out.abcd1234.partial"
    left.mkdir()
    write_result(left, "killed")
    (left / half).write_text((left / half).read_text()[:20])
    swap(tmp_path / "out", "new", force=False)
    assert {path.name: whole(path) for path in tmp_path.iterdir()} == {"out": "new"}


def test_an_empty_folder_in_its_place_does_not_cost_the_only_result(tmp_path):
    """As a script leaves that makes the folder first, after a kill between two renames."""
    swap(tmp_path / ".out.abcd1234.old" / "out", "old")
    (tmp_path / "out").mkdir()
    with pytest.raises(OutputError, match="MF402"):
        swap(tmp_path / "out", "new", force=False)
    assert {path.name: whole(path) for path in tmp_path.iterdir()} == {"out": "old"}


def test_a_document_in_a_result_that_had_lost_its_manifest_when_it_was_killed_is_kept(tmp_path):
    left = tmp_path / ".out.abcd1234.turn"
    left.mkdir()
    (left / "thesis.tex").write_text("mine")
    swap(tmp_path / "out", "new", force=False)
    assert [path.read_text() for path in (tmp_path / "out.kept").iterdir()] == ["mine"]
