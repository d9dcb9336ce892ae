"""What a run keeps and a later one takes: equal to the last bit, checked before use, and never in the way."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from random import Random

import pytest
from once import figures_in_words
from shared_tasks import printed
from small_job import listing, write_job

from maskfab.base.folders import TIMES
from maskfab.cli.program import run_command_line
from maskfab.mask.job import load_job
from maskfab.runs import pipeline
from maskfab.runs.recall import origin_of, recalled
from maskfab.runs.store import Origin, Store, give_result, keep_result

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")


@pytest.fixture
def store(tmp_path: Path) -> Store:
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    return Store(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, Store]]:
    """A small plate that was made with an empty cache: its folder, and what is kept."""
    folder = tmp_path_factory.mktemp("kept")
    (folder / "cache").mkdir(mode=0o700)
    store = Store(folder / "cache")
    with figures_in_words():
        pipeline.run(write_job(folder), folder / "out", cache=store)
    return folder, store


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != TIMES}


KEPT_RUN = tuple[dict[str, str], pipeline._Made]


def whole_run(folder: Path) -> Origin:
    """Of the plate that :func:`made` makes."""
    return pipeline.origin_of_run(load_job(folder / "job.toml"), None)


def no_work(*_: object) -> None:
    raise AssertionError("a stage ran")


def test_an_unchanged_job_is_taken_whole(made, tmp_path, monkeypatch):
    folder, store = made
    monkeypatch.setattr(pipeline, "measure_dies", no_work)
    again = pipeline.run(folder / "job.toml", tmp_path / "again", cache=store)
    assert content(tmp_path / "again") == content(folder / "out")
    assert again.passed
    times = json.loads((tmp_path / "again" / TIMES).read_text())
    assert list(times["seconds"]) == ["taken from the cache", "read back"]


def test_stages_are_taken_where_the_plate_is_another(made, tmp_path):
    """Another title changes no die: their optics and photographs are taken, and equal those that are found anew."""
    folder, store = made
    job = folder / "titled.toml"
    job.write_text((folder / "job.toml").read_text().replace("SMALL PLATE", "ANOTHER"))
    fresh = pipeline.run(job, tmp_path / "fresh")
    before = {entry.path for entry in store.entries()}
    taken = pipeline.run(job, tmp_path / "taken", cache=store)
    assert content(taken.directory) == content(fresh.directory)
    new = {entry.what for entry in store.entries() if entry.path not in before}
    assert not {"findings.optics.measure_with_bar", "findings.photographs.photograph_die"} & new


def test_damage_of_any_kept_file_is_noticed(made, tmp_path):
    """One byte of any entry that makes up a result: either it does not matter, or nothing is given and it is gone."""
    folder, store = made
    draw = Random(1)
    origin = whole_run(folder)
    hashes, _ = store.get(origin, KEPT_RUN).value
    own = [entry.path for entry in store.entries() if entry.path.name in {origin.key, *hashes.values()}]
    given = 0
    for number in range(20):
        copy, out = Store(tmp_path / f"cache{number}"), tmp_path / f"out{number}"
        for path in own:
            (copy.folder / path.parent.name).mkdir(parents=True, exist_ok=True)
            shutil.copy(path, copy.folder / path.parent.name)
        victim = copy.folder / (path := draw.choice(own)).parent.name / path.name
        body = bytearray(path.read_bytes())
        body[draw.randrange(len(body))] ^= draw.randrange(1, 256)
        victim.write_bytes(body)
        out.mkdir()
        if give_result(copy, origin, out, pipeline._Made) is not None:
            given += 1
            assert content(out) == content(folder / "out")
        else:
            assert content(out) == {}
            assert not victim.exists()
    assert given < 5


def test_a_damaged_finding_is_found_again(store):
    assert recalled(store, None, printed, 3).found == 3
    (entry,) = store.entries()
    for place in range(entry.bytes):
        body = bytearray(entry.path.read_bytes())
        body[place % len(body)] ^= 0x55  # what it took has more digits, or fewer
        entry.path.write_bytes(body)
        assert recalled(store, None, printed, 3).found == 3
    assert store.get(origin_of(printed, 3), int).value == 3


def test_what_is_used_longest_ago_goes_first(store, tmp_path):
    large = tmp_path / "large"
    large.write_bytes(bytes(1000))
    for number in range(4):
        path = store.folder / "00" / f"{number:064}"
        store.keep_file(path.name, large)
        os.utime(path, (number, number))
    removed = store.prune(2500)
    assert sorted(entry.path.name[-1] for entry in removed) == ["0", "1"]
    assert [entry.path.name[-1] for entry in store.entries()] == ["2", "3"]


def test_what_a_killed_process_left_is_swept(store):
    (store.folder / "ab").mkdir()
    (store.folder / "ab" / f".{'ab' * 32}.0123abcd.partial").write_bytes(b"half")
    store.prune()
    assert listing(store.folder / "ab") == {}


def test_a_cache_that_cannot_be_written_changes_nothing(tmp_path):
    (tmp_path / "cache").write_text("a file")
    store = Store(tmp_path / "cache")
    assert recalled(store, None, printed, 3).found == 3
    store.keep_file("0" * 64, Path(__file__))
    assert not list(store.entries())


def test_a_folder_that_others_may_write_is_not_used(tmp_path, monkeypatch):
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    monkeypatch.setenv("MASKFAB_CACHE", str(tmp_path / "open"))
    assert Store.of_user() is None
    monkeypatch.setenv("MASKFAB_CACHE", str(tmp_path / "own"))
    own = Store.of_user()
    assert own is not None
    assert own.folder.stat().st_mode & 0o077 == 0


def test_two_that_keep_the_same_at_once_do_not_harm_each_other(store, tmp_path):
    source = tmp_path / "result"
    source.mkdir()
    (source / "plate.gds").write_bytes(bytes(range(256)) * 4000)
    origin = Origin("told", ())
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: keep_result(store, origin, source, "told", str), range(16)))
    (tmp_path / "copy").mkdir()
    assert give_result(store, origin, tmp_path / "copy", str).value == "told"
    assert content(tmp_path / "copy") == content(source)


def test_the_command_shows_and_prunes(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MASKFAB_CACHE", str(tmp_path / "own"))
    own = Store.of_user()
    assert own is not None
    own.put(Origin("number", ()), 3, int)
    assert run_command_line(["self", "cache"]) == 0
    assert "number" in capsys.readouterr().out
    assert run_command_line(["self", "cache", "--limit", "0", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["kept"], told["removed"]["entries"]) == ({}, 1)
    for wrong in ("a lot", "1", "-1 GB", "nan GB", "1 TB"):
        assert run_command_line(["self", "cache", f"--limit={wrong}"]) == 2
        assert "MF105" in capsys.readouterr().err


@pytest.mark.slow
def test_a_run_that_is_killed_at_any_moment_is_taken_up_again(tmp_path):
    """kill -9 at random moments: the result that follows is that of an undisturbed run, and nothing is left behind."""
    job, draw = write_job(tmp_path), Random(2)
    environment = os.environ | {"MASKFAB_CACHE": str(tmp_path / "cache")}
    whole = [sys.executable, "-m", "maskfab", "run", str(job), "--quiet", "--out"]
    subprocess.run([*whole, str(tmp_path / "whole"), "--no-cache"], check=True, capture_output=True)
    command = [*whole, str(tmp_path / "out")]
    for _ in range(20):
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        try:
            process.wait(draw.uniform(0.5, 6))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            assert not (tmp_path / "out").exists()
        else:
            break
    else:
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    assert content(tmp_path / "out") == content(tmp_path / "whole")
    assert not list(tmp_path.glob(".out.*"))
