"""An output directory takes the place of an earlier result and of nothing else, whatever happens at that moment."""

from __future__ import annotations

import json
import os
import random
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from swaps import swap, whole, write_result

from maskfab.base.errors import OutputError
from maskfab.base.files import partial, stale
from maskfab.base.folders import check_file, check_target, put_back, staged, times_text, write_text

SWAPS = Path(__file__).parents[1] / "swaps.py"


@pytest.fixture(scope="module", params=[3, pytest.param(1, marks=pytest.mark.slow)], ids=["every third", "every"])
def rounds(request, tmp_path_factory) -> dict[str, list[dict[str, object]]]:
    words = [sys.executable, str(SWAPS), str(tmp_path_factory.mktemp("swaps")), str(request.param)]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=300)
    return json.loads(done.stdout)


@pytest.mark.parametrize("kind", ["exchange", "renames"])
def test_killed_before_any_system_call_the_folder_is_the_whole_old_or_the_whole_new_result(rounds, kind):
    told = rounds[f"kill {kind}"]
    assert {row["recovered"] for row in told} == {"old", "new"}
    assert all(row["code"] == -9 for row in told)
    assert all(row["at_once"] is not None for row in told) is (kind == "exchange")
    # The next run finds its way, and leaves nothing of what was killed.
    assert [row["left"] for row in told] == [["out"]] * len(told)


@pytest.mark.parametrize("kind", ["exchange", "renames"])
def test_ended_by_a_signal_before_any_system_call_nothing_is_left_but_one_result(rounds, kind):
    told = rounds[f"signal {kind}"]
    assert {row["recovered"] for row in told} == {"old", "new"}
    assert [row["left"] for row in told] == [["out"]] * len(told)
    assert all(row["names"] == ["out"] for row in told) or kind == "renames"


@pytest.mark.parametrize("kind", ["exchange", "renames"])
@pytest.mark.parametrize("how", ["add", "change"])
def test_what_somebody_writes_before_any_system_call_is_never_lost(rounds, how, kind):
    told = rounds[f"{how} {kind}"]
    assert [row["notes"] for row in told] == [1] * len(told)
    stopped = [row for row in told if row["code"] == 2]
    assert stopped
    for row in stopped:
        # Stopped before it was too late: both results stay, the new one whole under a name that was told.
        assert row["new"] == ["new"] or "late.txt" in row["names"] or any("kept" in name for name in row["names"]), row
    assert {row["code"] for row in told} == {0, 2}


@pytest.mark.parametrize("force", [False, True])
def test_no_document_is_lost_in_fifty_races(tmp_path, force):
    chance, told = random.Random(5), 0
    for number in range(50):
        target = tmp_path / f"{number}" / "out"
        if force:
            swap(target, "old")
        delay = chance.uniform(0, 0.003)

        def write(target: Path = target, delay: float = delay) -> None:
            time.sleep(delay)
            target.mkdir(parents=True, exist_ok=True)
            (target / "thesis.tex").write_text("mine")

        person = threading.Thread(target=write)
        person.start()
        try:
            swap(target, "new", force=force, meanwhile=lambda: time.sleep(0.001))
        except OutputError:
            told += 1
        person.join()
        assert [path.read_text() for path in tmp_path.glob(f"{number}/**/thesis.tex")] == ["mine"]
    assert told > 0


@pytest.mark.parametrize("force", [False, True])
def test_of_two_runs_into_one_folder_both_results_stay(tmp_path, force):
    target = tmp_path / "out"
    if force:
        swap(target, "old")
    with pytest.raises(OutputError, match=r"MF404.*out\.new") as caught:
        swap(target, "later", force=force, meanwhile=lambda: swap(target, "earlier", force=force))
    assert str(tmp_path / "out.new") in caught.value.what
    assert {path.name: whole(path) for path in tmp_path.iterdir()} == {"out": "earlier", "out.new": "later"}


def test_a_second_result_that_cannot_be_placed_has_a_name_of_its_own(tmp_path):
    target = tmp_path / "out"
    for word in ("a", "b", "c"):
        with pytest.raises(OutputError, match="MF404"):
            swap(target, word, meanwhile=lambda: target.mkdir(exist_ok=True) or (target / "mine").touch())
        (target / "mine").unlink()
    assert [whole(tmp_path / name) for name in ("out.new", "out.new-2", "out.new-3")] == ["a", "b", "c"]


SPOILT = {
    "another file": lambda out: (out / "thesis.tex").write_text("mine"),
    "a file of its own name that was changed": lambda out: (out / "a.txt").write_text("mine"),
    "a folder that the manifest claims": lambda out: (
        (out / "mine").mkdir(),
        (out / "mine" / "thesis.tex").write_text("mine"),
        (out / "manifest.json").write_text(
            json.dumps({"maskfab_version": "1", "files": [{"path": "mine", "sha256": ""}]})
        ),
    ),
    "a link": lambda out: ((out / "a.txt").unlink(), (out / "a.txt").symlink_to(out / "b.txt")),
    "times that are somebody's notes": lambda out: (out / "timing.json").write_text('{"seconds": {"lunch": "noon"}}'),
}


@pytest.mark.parametrize("spoil", SPOILT.values(), ids=SPOILT)
def test_what_the_manifest_does_not_know_by_its_hash_is_refused_before_any_work(tmp_path, spoil):
    target = tmp_path / "out"
    swap(target, "old")
    spoil(target)
    before = sorted(target.rglob("*"))
    with pytest.raises(OutputError, match="MF402"):
        check_target(target, force=True)
    assert sorted(target.rglob("*")) == before


def test_times_that_maskfab_wrote_are_its_own(tmp_path):
    target = tmp_path / "out"
    swap(target, "old")
    (target / "timing.json").write_text(times_text("None", {"optics": 1.25}))
    swap(target, "new")
    assert whole(target) == "new"


def test_a_link_stays_and_what_it_points_to_is_replaced(tmp_path):
    real, link = tmp_path / "disk" / "real", tmp_path / "out"
    for word, force in (("old", False), ("new", True)):
        real.parent.mkdir(exist_ok=True)
        if not link.is_symlink():
            link.symlink_to(real)
        swap(link, word, force=force)
        assert link.is_symlink()
        assert whole(real) == word
    assert sorted(path.name for path in tmp_path.iterdir()) == ["disk", "out"]


def test_a_link_that_leads_elsewhere_by_now_is_told(tmp_path):
    link = tmp_path / "out"
    link.symlink_to(tmp_path / "one")

    def turn() -> None:
        link.unlink()
        link.symlink_to(tmp_path / "two")

    with pytest.raises(OutputError, match="MF404"):
        swap(link, "new", meanwhile=turn)
    assert whole(tmp_path / "one.new") == "new"


def test_the_link_of_a_single_file_stays(tmp_path):
    real, link = tmp_path / "real.toml", tmp_path / "out.toml"
    link.symlink_to(real)
    write_text(link, "text")
    assert (link.is_symlink(), real.read_text()) == (True, "text")


@pytest.mark.parametrize("check", [check_target, check_file])
@pytest.mark.parametrize("name", ["n" * 300, "loop"])
def test_a_name_that_cannot_be_is_refused_before_any_work(tmp_path, check, name):
    if name == "loop":
        (tmp_path / name).symlink_to(name)
    with pytest.raises(OutputError, match="MF401"):
        check(tmp_path / name, force=False)


def test_a_device_is_no_file_to_replace():
    with pytest.raises(OutputError, match="MF401"):
        check_file(Path(os.devnull), force=True)


def test_what_a_living_process_writes_is_not_swept(tmp_path):
    target = tmp_path / "out"
    place = check_target(target, force=False)
    with staged(place) as first:
        write_result(first, "first")
        with suppress(ZeroDivisionError), staged(place) as second:
            assert first.exists()
            assert second != first
            raise ZeroDivisionError
        assert list(stale(target, ".partial")) == []
    assert whole(target) == "first"


def test_what_a_dead_process_left_of_a_file_is_swept_by_the_next(tmp_path):
    path = tmp_path / "x.gds"
    script = (
        "import os, sys; from pathlib import Path; from maskfab.base.files import partial\n"
        "with partial(Path(sys.argv[1])): os._exit(1)"
    )
    subprocess.run([sys.executable, "-c", script, str(path)], check=False, timeout=60)
    assert len(list(tmp_path.iterdir())) == 1
    with partial(path) as aside:
        aside.write_bytes(b"whole")
    assert list(tmp_path.iterdir()) == [path]


def test_a_file_that_came_meanwhile_stays_beside_the_new_one(tmp_path):
    path = tmp_path / "x.toml"
    with ExitStack() as work:
        work.enter_context(partial(path, replace=False)).write_text("new")
        path.write_text("mine")
        with pytest.raises(OutputError, match=r"MF404.*x\.new\.toml"):
            work.close()
    assert {each.name: each.read_text() for each in tmp_path.iterdir()} == {"x.toml": "mine", "x.new.toml": "new"}


@pytest.mark.parametrize("name", [".out.ab_d1234.old", ".out.abcd1234.old"])
def test_the_only_result_hidden_by_a_kill_between_two_renames_is_found_again(tmp_path, name):
    swap(tmp_path / name / "out", "old")
    put_back(tmp_path / "out")
    assert {path.name: whole(path) for path in tmp_path.iterdir()} == {"out": "old"}
