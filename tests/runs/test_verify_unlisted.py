"""What lies in a run's folder besides: a mask could go to the house by mistake, anything else is only told."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from small_job import command, finished

import maskfab

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here", "verified_once")


@pytest.fixture
def out(small_result, tmp_path) -> Path:
    return Path(shutil.copytree(small_result, tmp_path / "out"))


def unlisted(directory: Path) -> dict[str, bool | None]:
    return {check.value: check.passed for check in maskfab.verify(directory) if check.name == "unlisted"}


def test_masks_that_the_run_did_not_write_fail_and_other_files_are_notes(out):
    (out / "old").mkdir()
    for name in ("second.gds", "old/PLATE.OAS", "x.dxf", "x.gbr", "letter.txt", "screenshot.png", ".DS_Store"):
        (out / name).write_bytes(b"anything")
    assert unlisted(out) == {
        "second.gds": False,
        "old/PLATE.OAS": False,
        "x.dxf": False,
        "x.gbr": False,
        "letter.txt": None,
        "screenshot.png": None,
        ".DS_Store": None,
    }


def test_a_note_is_told_and_changes_no_verdict(capsys, out):
    assert unlisted(out) == {}
    (out / "letter.txt").write_text("dear house", encoding="utf-8")
    told = command(capsys, "verify", out, "--quiet")
    assert told.code == 0
    assert "NOTE unlisted = letter.txt: manifest.json does not know letter.txt" in told.stderr
    assert "PASS" in told.stderr
    answer = command(capsys, "verify", out, "--quiet", "--json")
    assert (answer.code, answer.document["verdict"]) == (0, "pass")


def test_a_second_mask_fails_the_folder(capsys, out):
    shutil.copy(out / "SMALL.gds", out / "SMALL (copy).gds")
    told = command(capsys, "verify", out, "--quiet")
    assert told.code == 1
    assert "FAIL unlisted = SMALL (copy).gds" in told.stderr
    assert "could go to the house by mistake" in told.stderr


def test_where_pictures_are_masks_a_further_picture_is_one(tmp_path):
    out = finished(tmp_path, ("[[die]]", '[export]\nformats = ["gdsii", "png"]\ndots_per_um = 0.25\n\n[[die]]'))
    (out / "other.png").write_bytes(b"anything")
    assert unlisted(out) == {"other.png": False}
