"""The report on paper: printed by a browser that is installed, equal when made again, or refused before any work."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from small_job import command, write_job

from maskfab.base.provenance import sha256_of_file
from maskfab.runs import paper
from maskfab.runs.verification import reproduce, verify

pytestmark = pytest.mark.usefixtures("read_here")


@pytest.fixture
def browsers(tmp_path, monkeypatch):
    """An empty folder that alone is looked through for browsers."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    return folder


def program(folder: Path, name: str, text: str) -> None:
    path = folder / name
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)


def test_without_a_browser_a_print_is_refused_before_any_work(capsys, tmp_path, browsers):
    answer = command(capsys, "run", write_job(tmp_path), "--out", tmp_path / "out", "--pdf", "--quiet")
    assert answer.code == 2
    assert answer.stderr.startswith("error: MF438") or "MF438" in answer.stderr
    assert "print report.html from any browser" in answer.stderr
    assert not (tmp_path / "out").exists()


def test_the_first_browser_of_the_path_prints(browsers):
    program(browsers, "msedge", "exit 0")
    assert paper.browser() == str(browsers / "msedge")
    program(browsers, "chromium", "exit 0")
    assert paper.browser() == str(browsers / "chromium")


@pytest.mark.usefixtures("drawn_in_words", "measured_once")
def test_a_browser_that_prints_nothing_is_told_with_its_last_words(capsys, tmp_path, browsers):
    program(browsers, "google-chrome", "echo no display here >&2; exit 1")
    answer = command(capsys, "run", write_job(tmp_path), "--out", tmp_path / "out", "--pdf", "--quiet")
    assert answer.code == 2
    assert "MF439" in answer.stderr
    assert "no display here" in answer.stderr
    assert [path.name for path in tmp_path.iterdir() if "out" in path.name] == []


@pytest.mark.usefixtures("verified_once", "drawn_in_words")
def test_a_report_is_printed_that_verifies_and_is_printed_again_to_the_last_byte(capsys, tmp_path):
    if not any(map(shutil.which, paper.BROWSERS)):
        pytest.skip("no browser that prints is installed")
    out = tmp_path / "out"
    job = write_job(tmp_path, ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]'))
    answer = command(capsys, "run", job, "--out", out, "--pdf", "--quiet")
    assert answer.code == 0, answer.stderr
    again = reproduce(out)
    assert again.passed
    assert "report.pdf" in {file.name for file in again.files}
    printed = out / "report.pdf"
    content = printed.read_bytes()
    assert content.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", content)) == 4
    assert str(tmp_path).encode() not in content
    assert b"file://" not in content
    rows = {row["path"]: row for row in json.loads((out / "manifest.json").read_text())["files"]}
    assert rows["report.pdf"]["sha256"] == sha256_of_file(printed)
    assert all(check.passed for check in verify(out).checks)
    printed.write_bytes(content + b"%")
    (changed,) = (check for check in verify(out).checks if not check.passed)
    assert changed.method == "SHA-256 of report.pdf"
