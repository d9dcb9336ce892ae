"""Work on a file is ended when it takes more than a file like it may, whatever library does it, and that is told."""

from __future__ import annotations

import io
import json
import multiprocessing
import os
import pickle
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from klayout import db
from numpy.typing import NDArray

from maskfab.base.errors import InternalError, OpeningError, SourceError
from maskfab.mask import sandbox
from maskfab.mask.process_limits import allow
from maskfab.mask.sandbox import answer_message, bounded, library_errors, read_apart

pytestmark = pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="limits are those of a copied process"
)


@pytest.fixture
def file(tmp_path):
    """For so few bytes one second is added to what a file may take."""
    path = tmp_path / "small.gds"
    path.write_bytes(b"1234")
    return path


def refusal(file, work, **options):
    with pytest.raises(SourceError) as caught:
        bounded(file, work, kind=str, **options)
    assert "small.gds" in caught.value.what
    assert caught.value.where == str(file)
    assert caught.value.cure
    return caught.value


def busy(seconds):
    while time.process_time() < seconds:
        pass


def test_the_answer_comes_back_and_so_does_what_is_told_on_the_way(file):
    heard = []

    def work(tell):
        tell("rules", 1, 2)
        return np.arange(3), os.getpid()

    answer, process = bounded(file, work, lambda *said: heard.append(said), kind=tuple[NDArray[np.int64], int])
    assert answer.tolist() == [0, 1, 2]
    assert heard == [("rules", 1, 2)]
    assert process != os.getpid()


def test_what_does_not_come_to_an_end_is_ended_and_the_stage_told(file):
    def work(tell):
        tell("rules", 0, 1)
        busy(60)

    spent = time.perf_counter()
    error = refusal(file, work, seconds=0)
    assert (error.code, "'rules'" in error.what) == ("MF322", True)
    assert time.perf_counter() - spent < 30


def test_a_library_that_cannot_be_interrupted_is_ended_too(file):
    comb = [db.Region([db.Polygon(db.Box(0, 40 * k, 200_000, 40 * k + 20)) for k in range(5000)])]
    comb.append(comb[0].transformed(db.Trans(1, False, 200_000, 0)))
    assert refusal(file, lambda _: (comb[0] & comb[1]).count(), seconds=0).code == "MF322"


def test_what_is_allowed_for_honest_work_is_there(file):
    def work(_):
        allow(3)
        busy(1.1)
        return "done"

    assert bounded(file, work, kind=str, seconds=0) == "done"


def test_what_a_reader_takes_is_taken_of_the_same_share(file, tmp_path):
    script = tmp_path / "reader.py"
    script.write_text(
        "import sys, time\nfrom maskfab.mask.sandbox import answer_message\n"
        "while time.process_time() < 1.05:\n    pass\nsys.stdout.buffer.write(answer_message('read', str))",
        encoding="utf-8",
    )

    def work(tell):
        answer = read_apart(file, script, kind=str, seconds=60)
        tell("rules", 0, 1)
        busy(1.2)
        return answer

    error = refusal(file, work, seconds=1)
    assert (error.code, "'rules'" in error.what) == ("MF322", True)
    # Which would do for the rest alone.
    assert bounded(file, lambda _: busy(1.2), kind=type(None), seconds=1) is None


def test_allowing_more_changes_nothing_where_nothing_is_limited():
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_CPU), resource.getrlimit(resource.RLIMIT_DATA)
    allow(5, 1000)
    assert (resource.getrlimit(resource.RLIMIT_CPU), resource.getrlimit(resource.RLIMIT_DATA)) == before


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="memory is limited on Linux")
def test_what_fills_memory_is_refused(file):
    error = refusal(file, lambda _: np.full(2_000_000_000, 1, dtype=np.uint8).sum())
    assert (error.code, "memory" in error.what) == ("MF322", True)


@pytest.mark.parametrize("end", [lambda: os._exit(1), lambda: os.kill(os.getpid(), signal.SIGTERM)])
def test_a_process_that_dies_is_told(file, end):
    assert refusal(file, lambda _: end()).code == "MF322"


def test_what_a_library_throws_is_told_and_not_ours(file):
    error = refusal(file, lambda _: db.Layout().read(str(file)))
    assert (error.code, "gives up" in error.what) == ("MF323", True)


def test_an_error_of_ours_comes_as_it_is(file):
    def work(_):
        raise OpeningError("MF203", "it is closed", where="here", cure="Open it")

    with pytest.raises(OpeningError) as caught:
        bounded(file, work, kind=str)
    assert (caught.value.code, caught.value.where) == ("MF203", "here")


def test_a_fault_of_ours_stays_one(file):
    with pytest.raises(InternalError, match="MF901 ZeroDivisionError") as caught:
        bounded(file, lambda _: 1 // 0, kind=int)
    assert "test_bounded" in caught.value.__notes__[0]


class Planted:
    """A pickle that writes a file when it is read."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def packed(**arrays):
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


FORGED = [
    lambda path: pickle.dumps(("answer", Planted(path))),
    lambda path: b"A" + pickle.dumps(Planted(path)),
    lambda path: b"A" + packed(tree=np.frombuffer(b"1", np.uint8), zeros=np.zeros(10_000_000)),
    lambda path: answer_message("a word", str),
    lambda path: b"A",
    lambda path: b"E" + json.dumps(["Popen", "MF303", "", "", "", ""]).encode(),
    lambda path: b"E" + json.dumps(["SourceError", "MF000", "", "", "", ""]).encode(),
    lambda path: b"E" + json.dumps(["SourceError", "MF303", 1, "", "", ""]).encode(),
    lambda path: b"P" + json.dumps(["rules", "1", None]).encode(),
    lambda path: b"X",
    lambda path: b"",
]


@pytest.mark.parametrize("forge", FORGED)
def test_nothing_but_an_answer_comes_of_a_process_that_a_file_took_over(file, tmp_path, monkeypatch, forge):
    """Whatever it says in place of its answer is refused, and runs nothing here."""
    planted = tmp_path / "ran"
    message = forge(planted)
    monkeypatch.setattr(sandbox, "answer_message", lambda answer, kind: message)
    error = refusal_of_kind(file, lambda _: 1, int)
    assert error.code == "MF327"
    assert not planted.exists()
    script = tmp_path / "reader.py"
    script.write_text(f"import sys; sys.stdout.buffer.write({message!r})", encoding="utf-8")
    with pytest.raises(SourceError, match="MF327"):
        read_apart(file, script, kind=int, seconds=60)
    assert not planted.exists()


def refusal_of_kind(file, work, kind):
    with pytest.raises(SourceError) as caught:
        bounded(file, work, kind=kind)
    return caught.value


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="memory is limited on Linux")
def test_an_answer_longer_than_all_memory_that_it_may_take_is_refused(file, monkeypatch):
    monkeypatch.setattr(sandbox, "MEMORY", 1000)
    monkeypatch.setattr(sandbox, "limit_memory", lambda most: None)
    assert refusal_of_kind(file, lambda _: "x" * 10_000, str).code == "MF327"


def test_what_klayout_throws_is_an_error_of_the_file_and_a_fault_of_ours_is_not(file):
    with pytest.raises(SourceError, match=r"MF323 small\.gds.*unknown format"), library_errors(file):
        db.Layout().read(str(file))
    with pytest.raises(RecursionError), library_errors(file):
        raise RecursionError("deep")
