"""A slice of what ``tests/fuzz_readers.py`` does at length: damaged files never end or hang what reads them."""

from __future__ import annotations

import subprocess
import sys

import fuzz_originals
import fuzz_readers
import pytest
from small_job import OPENING

SLICE = 150
COSTLY = {"gdsii": 30, "oasis": 30, "dxf": 40, "gerber": 40, "step": 6}
"""These start a process of their own for every file that is not refused at first sight, or read long text."""


@pytest.mark.parametrize("reader", fuzz_originals.SUFFIXES)
def test_damaged_files_are_refused_or_seen(reader, tmp_path):
    path = tmp_path / fuzz_originals.file_name(reader)
    if reader == "job":
        (tmp_path / "ring.toml").write_text(OPENING, encoding="utf-8")
    outcomes = {}
    for number in range(COSTLY.get(reader, SLICE)):
        path.write_bytes(fuzz_readers.damaged(reader, number))
        outcomes[number] = fuzz_readers.outcome(reader, path)
    assert {number: said for number, said in outcomes.items() if said.startswith("FINDING")} == {}
    assert sum(said.startswith("refused") for said in outcomes.values()) > len(outcomes) / 3


@pytest.mark.parametrize("reader", fuzz_originals.SUFFIXES)
def test_what_is_damaged_was_whole_before(reader, tmp_path):
    path = tmp_path / fuzz_originals.file_name(reader)
    if reader == "job":
        (tmp_path / "ring.toml").write_text(OPENING, encoding="utf-8")
    for original in fuzz_originals.originals(reader):
        path.write_bytes(original)
        assert fuzz_readers.outcome(reader, path) == "same"


def test_a_process_that_hangs_is_ended_and_told(monkeypatch):
    monkeypatch.setattr(fuzz_readers, "SECONDS", 0.1)
    worker = fuzz_readers.Worker("gdsii")
    worker.process = silent = subprocess.Popen(
        [sys.executable, "-S", "-c", "import time; time.sleep(60)"],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert worker.outcome(0) == "FINDING: no answer within 0.1 s"
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
