"""Runs that meet a full disk, or each other: nothing half-written, nothing broken, and the same files afterwards."""

from __future__ import annotations

import errno
import hashlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from small_job import listing, with_the_die, write_job

from maskfab.base.errors import OutputError
from maskfab.base.folders import TIMES
from maskfab.runs import pipeline
from maskfab.runs import store as store_module
from maskfab.runs.store import Origin, Store

resource = pytest.importorskip("resource")
pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.name != TIMES}


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """No file may become larger: what a full disk does to whichever comes first."""
    before = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, before)


def sound(path: Path) -> bool:
    """Whether an entry is whole: its first 64 bytes are the hash of the others."""
    content = path.read_bytes()
    return content[:64].decode() == hashlib.sha256(content[64:]).hexdigest()


@contextmanager
def full(path: Path) -> Iterator[Path]:
    """In place of a file that is made aside."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    yield path


def test_a_disk_that_fills_at_five_moments(tmp_path):
    """Each limit stops another file; all that is left is what was found, and the run that follows is undisturbed."""
    (tmp_path / "cache").mkdir(mode=0o700)
    store, job = Store(tmp_path / "cache"), with_the_die("TURNED", write_job(tmp_path))
    fresh = content(pipeline.run(job, tmp_path / "fresh", cache=store).directory)
    for entry in store.entries():
        if entry.what in {"run", "file"}:
            entry.path.unlink()
    sizes = sorted({len(body) for body in fresh.values()})
    moments = [sizes[len(sizes) * number // 5] for number in range(5)]
    assert len(set(moments)) == 5
    (tmp_path / "disk").mkdir()
    for size in moments:
        with files_of_at_most(size - 1), pytest.raises(OutputError) as refused:
            pipeline.run(job, tmp_path / "disk" / "out", cache=store)
        assert refused.value.code == "MF401"
        assert listing(tmp_path / "disk") == {}
        assert all(sound(entry.path) for entry in store.entries() if entry.what != "file")
        assert not list(store.folder.glob("*/.*"))
    assert content(pipeline.run(job, tmp_path / "disk" / "out", cache=store).directory) == fresh


def test_a_full_disk_of_the_cache_is_nobodys_affair(tmp_path, monkeypatch):
    (tmp_path / "cache").mkdir(mode=0o700)
    store = Store(tmp_path / "cache")

    monkeypatch.setattr(store_module, "partial", full)
    origin = Origin("number", ())
    store.put(origin, 3, int)
    store.keep_file("1" * 64, Path(__file__))
    assert listing(tmp_path / "cache") == {origin.key[:2]: None, "11": None}
    assert store.get(origin, int) is None


@pytest.mark.slow
@pytest.mark.parametrize("where", ["a file", "full"])
def test_a_run_succeeds_without_a_cache_that_takes_nothing(tmp_path, where, monkeypatch):
    if where == "a file":
        (tmp_path / "cache").write_text("no folder")
    else:
        (tmp_path / "cache").mkdir(mode=0o700)
    monkeypatch.setattr(store_module, "partial", full)
    job = write_job(tmp_path)
    alone = pipeline.run(job, tmp_path / "alone")
    cached = pipeline.run(job, tmp_path / "cached", cache=Store(tmp_path / "cache"))
    assert content(cached.directory) == content(alone.directory)


@pytest.mark.slow
@pytest.mark.parametrize("outs", [("a", "b"), ("a", "a")])
def test_two_runs_at_once_with_one_cache(tmp_path, outs):
    """Into two folders: the same bytes. Into one: one of them wins, and the other says where its own lies."""
    job = write_job(tmp_path)
    environment = os.environ | {"MASKFAB_CACHE": str(tmp_path / "cache")}
    command = [sys.executable, "-m", "maskfab", "run", str(job), "--quiet", "--out"]
    told = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    # In a process of its own too, whose pictures are real ones.
    subprocess.run([*command, str(tmp_path / "whole"), "--no-cache"], env=environment, check=True, **told)
    whole = content(tmp_path / "whole")
    both = [subprocess.Popen([*command, str(tmp_path / out)], env=environment, **told) for out in outs]
    said = [process.communicate(timeout=300)[1].decode() for process in both]
    codes = sorted(process.returncode for process in both)
    if outs[0] != outs[1]:
        assert codes == [0, 0], said
        assert content(tmp_path / "b") == whole
    else:
        assert codes == [0, 2], said
        assert any("MF404" in each or "MF402" in each for each in said)
    assert content(tmp_path / "a") == whole
    assert not list(tmp_path.glob(".*.partial"))
    store = Store(tmp_path / "cache")
    assert all(sound(entry.path) for entry in store.entries() if entry.what != "file")
