"""A slice of what ``tests/fuzz_readers.py`` does at length: damaged files never end or hang what reads them."""

from __future__ import annotations

import subprocess
import sys
import time
from importlib import import_module

import fuzz_originals
import fuzz_readers
import pytest
from small_job import OPENING

from maskfab.mask.formats import gdsii, gerber, step

SLICE = 150
FEWER = {"gdsii": 30, "oasis": 30, "dxf": 15, "gerber": 40, "cif": 60, "step": 6, "package": 40}
"""These are read by libraries of others, or hold long text or many files."""

APART = ("gdsii", "oasis", "gerber", "step")
"""maskfab starts a process for each of these, for which a copy of this one stands here."""


@pytest.fixture
def one_process(monkeypatch):
    """The readers as they are in a worker of the fuzzer, for this process to be copied for every file."""
    for module, name in ((gdsii, "_read_cells"), (gerber, "read_apart"), (step, "read_apart")):
        monkeypatch.setattr(module, name, getattr(module, name))
    fuzz_readers.in_one_process()
    import_module("gerbonara")


@pytest.mark.usefixtures("one_process")
@pytest.mark.parametrize("share", [12, pytest.param(1, marks=pytest.mark.slow)], ids=["twelfth", "all"])
@pytest.mark.parametrize("reader", fuzz_originals.SUFFIXES)
def test_damaged_files_are_refused_or_seen(reader, share, tmp_path):
    numbers = range(max(2 if reader == "step" else 6, FEWER.get(reader, SLICE) // share))
    found = fuzz_readers.Findings(reader)
    path = tmp_path / fuzz_originals.file_name(reader)
    if reader == "job":
        (tmp_path / "ring.toml").write_text(OPENING, encoding="utf-8")
    # What is imported and drawn on the way is so once, not in every copy.
    path.write_bytes(fuzz_originals.originals(reader)[0])
    assert fuzz_readers.outcome(reader, path) == "same"
    for number in numbers:
        path.write_bytes(fuzz_readers.damaged(reader, number))
        if reader in APART:
            found.take(number, fuzz_readers.apart(reader, path))
        else:
            found.note(number, fuzz_readers.outcome(reader, path), 0, 0)
    assert found.findings == {}
    refused = sum(times for said, times in found.outcomes.items() if said.startswith("refused"))
    assert refused > len(numbers) / 3


@pytest.mark.parametrize(
    "reader",
    [pytest.param(each, marks=[pytest.mark.slow] * (each in ("step", "package"))) for each in fuzz_originals.SUFFIXES],
)
def test_what_is_damaged_was_whole_before(reader, tmp_path):
    path = tmp_path / fuzz_originals.file_name(reader)
    if reader == "job":
        (tmp_path / "ring.toml").write_text(OPENING, encoding="utf-8")
    for original in fuzz_originals.originals(reader):
        path.write_bytes(original)
        assert fuzz_readers.outcome(reader, path) == "same"


@pytest.mark.slow
def test_a_worker_finds_what_a_copy_of_this_process_finds(one_process, tmp_path):
    found = fuzz_readers.fuzz("gerber", range(8))
    here = fuzz_readers.Findings("gerber")
    path = tmp_path / "x.gbr"
    for number in range(8):
        path.write_bytes(fuzz_readers.damaged("gerber", number))
        here.take(number, fuzz_readers.apart("gerber", path))
    assert found.outcomes == here.outcomes
    assert found.outcomes.total() == 8


def test_a_process_that_hangs_is_ended_and_told(monkeypatch):
    monkeypatch.setattr(fuzz_readers, "SECONDS", 0.1)
    worker = fuzz_readers.Worker("gdsii")
    worker.process = silent = subprocess.Popen(
        [sys.executable, "-S", "-c", "import time; time.sleep(60)"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert worker.outcome(0).startswith("FINDING: no answer within 0.3")
    assert silent.returncode is not None
    for pipe in (silent.stdin, silent.stdout):
        pipe.close()


def test_a_process_that_ends_is_told():
    worker = fuzz_readers.Worker("gdsii")
    worker.process = gone = subprocess.Popen(
        [sys.executable, "-S", "-c", "input(); raise SystemExit(9)"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert worker.outcome(0) == "FINDING: the process ended with 9"
    for pipe in (gone.stdin, gone.stdout):
        pipe.close()


def test_damage_is_the_same_for_the_same_number():
    assert fuzz_readers.damaged("gdsii", 3) == fuzz_readers.damaged("gdsii", 3)
    assert fuzz_readers.damaged("gdsii", 3) != fuzz_readers.damaged("gdsii", 4)


@pytest.mark.parametrize(("seconds", "size", "found"), [(9.9, 1.9e9, 0), (10.1, 1e6, 1), (0.1, 2.1e9, 1)])
def test_what_takes_longer_or_more_memory_than_stated_is_a_finding(seconds, size, found):
    noted = fuzz_readers.Findings("dxf")
    noted.note(7, "refused MF303", seconds, size)
    assert list(noted.findings) == ["dxf:7"] * found
    assert (noted.slowest, noted.largest) == (seconds, size)


def test_time_and_memory_are_those_of_the_reading_process(tmp_path, monkeypatch):
    def costly(*_):
        held = bytearray(500_000_000)
        held[::4096] = bytes([1]) * len(held[::4096])
        start = time.process_time()
        while time.process_time() < start + 0.3:
            pass
        return "seen"

    monkeypatch.setattr(fuzz_readers, "outcome", costly)
    said, cost = fuzz_readers.apart("dxf", tmp_path / "x.dxf").split("\t")
    seconds, size = map(float, cost.split())
    assert said == "seen"
    assert 0.3 <= seconds < 3
    assert size > 5e8
