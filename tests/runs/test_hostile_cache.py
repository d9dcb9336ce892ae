"""Entries of a cache that were exchanged, renamed, cut, planted or opened to others: none is used, and none runs."""

from __future__ import annotations

import hashlib
import io
import json
import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from klayout import db
from once import figures_in_words
from shared_tasks import printed
from small_job import command, write_job
from sweeps import sweep

from maskfab.base.folders import TIMES
from maskfab.base.plain_data import to_data
from maskfab.mask.job import load_job
from maskfab.runs import pipeline
from maskfab.runs.recall import origin_of, recalled
from maskfab.runs.store import Store, keep_result

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")
NOBODY = 65534


@pytest.fixture
def store(tmp_path: Path) -> Store:
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    return Store(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the job of a small plate, the plate, and the cache that it was made with."""
    folder = tmp_path_factory.mktemp("hostile")
    (folder / "cache").mkdir(mode=0o700)
    with figures_in_words():
        pipeline.run(write_job(folder), folder / "out", cache=Store(folder / "cache"))
    return folder


def copied(made: Path, tmp_path: Path) -> Store:
    return Store(Path(shutil.copytree(made / "cache", tmp_path / "cache")))


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != TIMES}


def of_three(store: Store) -> Path:
    """The entry of a finding, which is now kept."""
    recalled(store, None, printed, 3)
    return store.folder / (key := origin_of(printed, 3).key)[:2] / key


def refused(store: Store) -> str:
    """Why the entry of that finding was refused, which was found again as it should be."""
    again = recalled(store, None, printed, 3)
    assert again.found == 3
    assert again.account is not None
    assert not again.account.kept
    return str(again.account.refused)


@pytest.mark.parametrize("what", sweep(["photograph_die", "measure_with_bar"], 1))
def test_findings_of_two_dies_exchanged_are_found_again(made, tmp_path, what):
    store = copied(made, tmp_path)
    entries = [entry.path for entry in store.entries() if entry.what.endswith(what)]
    (whole,) = (entry.path for entry in store.entries() if entry.what == "run")
    assert len(entries) == 2
    whole.unlink()
    for path, body in zip(entries, [path.read_bytes() for path in reversed(entries)], strict=True):
        path.write_bytes(body)
    run = pipeline.run(made / "job.toml", tmp_path / "out", cache=store)
    assert content(run.directory) == content(made / "out")
    told = json.loads((run.directory / TIMES).read_text())["findings"]
    other = [row for row in told if row["refused"] == "it was found from something else"]
    assert [(row["die"], row["kept"]) for row in other] == [("PLAIN", False), ("TURNED", False)]
    assert "2 kept findings refused" in run.origin


def test_an_entry_under_another_key_is_refused(store):
    path = of_three(store)
    recalled(store, None, printed, 4)
    other = origin_of(printed, 4).key
    shutil.copy(store.folder / other[:2] / other, path)
    assert refused(store) == "it was found from something else"


def test_a_cut_entry_is_refused(store):
    path = of_three(store)
    whole = path.read_bytes()
    for length in (0, 1, 63, 64, 65, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        assert refused(store) == "its content is not what was written"


class Planted:
    """A pickle that writes a file when it is read."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def forged(path: Path, body: bytes) -> None:
    """Another body under the head of an entry, with the hash that belongs to it."""
    rest = path.read_bytes()[64:].partition(b"\n")[0] + b"\n" + body
    path.write_bytes(hashlib.sha256(rest).hexdigest().encode() + rest)


def of_objects(planted: Path) -> bytes:
    array, buffer = np.empty(1, dtype=object), io.BytesIO()
    array[0] = Planted(planted)
    np.savez(buffer, tree=array)
    return buffer.getvalue()


def test_a_planted_pickle_does_not_run(store, tmp_path):
    planted = tmp_path / "ran"
    path = of_three(store)
    for body in (pickle.dumps(Planted(planted)), of_objects(planted)):
        forged(path, body)
        assert "it cannot be read" in refused(store)
    # As earlier versions kept them.
    body = pickle.dumps(Planted(planted))
    head = {"form": 1, "what": "printed", "sha256": hashlib.sha256(body).hexdigest()}
    path.write_bytes(json.dumps(head).encode() + b"\n" + body)
    assert refused(store)
    assert not planted.exists()


@pytest.mark.parametrize(("value", "kind"), [("3", str), ((3,), tuple[int]), (3.0, float), (b"3", bytes)])
def test_a_finding_of_another_kind_is_refused(store, value, kind):
    forged(of_three(store), to_data(value, kind))
    assert "it cannot be read" in refused(store)


LEVELS: dict[str, Callable[[Path], Path]] = {
    "folder": lambda path: path.parent.parent,
    "subfolder": lambda path: path.parent,
    "entry": lambda path: path,
}


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("mode", [0o020, 0o002])
def test_what_others_may_write_is_not_used(store, level, mode):
    opened = LEVELS[level](of_three(store))
    opened.chmod(opened.stat().st_mode | mode)
    assert "others may write" in refused(store)
    if level != "folder":  # which is the user's to close
        assert recalled(store, None, printed, 3).account.kept


@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root gives files away")
def test_what_is_anothers_is_not_used(store, level):
    os.chown(LEVELS[level](of_three(store)), NOBODY, NOBODY)
    assert "belongs to another account" in refused(store)


def test_links_and_pipes_are_not_followed(store, tmp_path):
    path = of_three(store)
    moved = path.rename(tmp_path / "moved")
    path.symlink_to(moved)
    assert "it cannot be read" in refused(store)
    assert not path.is_symlink()
    path.unlink()
    os.mkfifo(path, 0o600)
    assert refused(store) == "it is no file"
    os.rename(path.parent, tmp_path / "sub")
    path.parent.symlink_to(tmp_path / "sub")
    assert "is no folder" in refused(store)


def test_files_of_a_whole_run_are_read_back(made, tmp_path):
    """A forger with hashes of his own takes a polygon away: the files are read, and made again."""
    job = load_job(made / "job.toml")
    store, origin = copied(made, tmp_path), pipeline.origin_of_run(job, None)
    files, kept = store.get(origin, tuple[dict[str, str], pipeline._Made]).value
    tampered = Path(shutil.copytree(made / "out", tmp_path / "tampered"))
    path = next(tampered.glob("*.gds"))
    layout = db.Layout()
    layout.read(str(path))
    for cell in layout.each_cell():
        for layer in layout.layer_indexes():
            for shape in list(cell.shapes(layer).each())[:1]:
                shape.delete()
    layout.write(str(path))
    keep_result(store, origin, tampered, kept, pipeline._Made)
    forged_files, _ = store.get(origin, tuple[dict[str, str], pipeline._Made]).value
    assert forged_files != files
    run = pipeline.run(job, tmp_path / "out", cache=store)
    assert content(run.directory) == content(made / "out")


def test_a_run_tells_what_was_kept(made, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("MASKFAB_CACHE", str(copied(made, tmp_path).folder))
    first = json.loads((made / "out" / TIMES).read_text())["findings"]
    assert {(row["kept"], row["refused"]) for row in first} == {(False, None)}
    assert {"findings.optics.measure_with_bar", "findings.photographs.photograph_die"} <= {row["what"] for row in first}
    again = command(capsys, "run", made / "job.toml", "--out", tmp_path / "out", "--json")
    times = json.loads((tmp_path / "out" / TIMES).read_text())
    assert times["findings"] == [row | {"kept": True} for row in first] == again.document["findings"]
    assert again.document["provenance"] == TIMES
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["provenance"] == TIMES
    replaced = command(capsys, "run", made / "job.toml", "--out", tmp_path / "out", "--force", "--no-cache")
    assert replaced.code == 0
    assert json.loads((tmp_path / "out" / TIMES).read_text())["findings"] == []
    assert not list(tmp_path.glob("out?*"))
