"""Commands that are ended from outside, or whose folder somebody uses meanwhile."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from small_job import listing, write_job

from maskfab.api.making import run
from maskfab.base.errors import OutputError
from maskfab.base.folders import check_target, staged
from maskfab.cli import program


def started(*words: object) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "maskfab", *map(str, words)], stderr=subprocess.DEVNULL)


def wait_for(folder: Path, pattern: str) -> None:
    for _ in range(3000):
        if any(folder.glob(pattern)):
            return
        time.sleep(0.01)
    raise TimeoutError(pattern)


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGTERM,
        pytest.param(signal.SIGHUP, marks=pytest.mark.slow),
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        *(
            pytest.param(getattr(signal, name), marks=pytest.mark.slow)
            for name in ("SIGQUIT", "SIGUSR1", "SIGALRM", "SIGRTMIN")
            if hasattr(signal, name)
        ),
    ],
)
def test_a_run_that_a_signal_ends_leaves_nothing(tmp_path, number):
    job = write_job(tmp_path)
    before = listing(tmp_path)
    process = started("run", job, "--out", tmp_path / "out", "--quiet")
    wait_for(tmp_path, ".out.*.partial/*")
    process.send_signal(number)
    assert process.wait(60) == 128 + number
    assert listing(tmp_path) == before


ENDING = [
    getattr(signal, name)
    for name in (
        *("SIGHUP", "SIGQUIT", "SIGABRT", "SIGUSR1", "SIGUSR2", "SIGALRM", "SIGTERM", "SIGXCPU", "SIGVTALRM"),
        *("SIGPROF", "SIGIO", "SIGPWR", "SIGSYS", "SIGTRAP", "SIGRTMIN", "SIGRTMAX"),
    )
    if hasattr(signal, name)
]
"""Signals that end a process unless it asks otherwise, by signal(7), faults of the process itself aside."""


@pytest.fixture
def default_handler(number):
    """The system's own, which a test run in the background, or by nohup, has not for every signal."""
    before = signal.signal(number, signal.SIG_DFL)
    yield
    signal.signal(number, before)


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize("number", ENDING, ids=lambda number: signal.Signals(number).name)
def test_every_signal_that_ends_a_process_ends_a_command_in_order(tmp_path, monkeypatch, default_handler, number):
    """A staged folder is removed, handlers are put back, and the exit code names the signal."""
    place = check_target(tmp_path / "out", force=False)

    def cited(*_):
        with staged(place) as folder:
            (folder / "half").write_text("half", encoding="utf-8")
            signal.raise_signal(number)
            raise AssertionError("it goes on")

    monkeypatch.setattr(program, "_run", cited)
    assert program.run_command_line(["self", "cite"]) == 128 + number
    assert list(tmp_path.iterdir()) == []
    assert signal.getsignal(number) == signal.SIG_DFL


@pytest.mark.slow
def test_what_a_killed_run_leaves_is_swept_by_the_next(tmp_path):
    job = write_job(tmp_path)
    process = started("run", job, "--out", tmp_path / "out", "--quiet")
    wait_for(tmp_path, ".out.*.partial/*")
    process.kill()
    process.wait(60)
    assert list(tmp_path.glob(".out.*"))
    run(job, tmp_path / "out")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["job.toml", "out", "ring.toml"]


@pytest.mark.usefixtures("drawn_in_words", "measured_once", "read_here")
def test_a_document_that_comes_while_a_plate_is_made_is_never_lost(tmp_path):
    job, out = write_job(tmp_path), tmp_path / "out"

    def put(stage: str, done: int, total: int) -> None:
        if stage == "optics":
            out.mkdir(exist_ok=True)
            (out / "thesis.tex").write_text("mine")

    with pytest.raises(OutputError, match=r"MF404.*out\.new"):
        run(job, out, progress=put)
    assert (out / "thesis.tex").read_text() == "mine"
    assert (tmp_path / "out.new" / "report.json").is_file()
