"""Small jobs with sections of a display, and what is refused of them."""

from __future__ import annotations

from pathlib import Path

from small_job import OPENING, command, listing, write_job


def job(folder: Path, extra: str, *edits: tuple[str, str], drawing: str = OPENING) -> Path:
    path = write_job(folder, *edits, opening=drawing)
    path.write_text(path.read_text(encoding="utf-8") + extra, encoding="utf-8")
    return path


def check_refused(capsys, folder: Path, extra: str, code: str, said: str) -> None:
    """A run is refused by code, with a cure, before anything is written."""
    path = job(folder, extra)
    before = listing(folder)
    answer = command(capsys, "run", path, "--out", folder / "out", "--json")
    assert answer.code == 2, answer
    error = answer.document["error"]
    assert error["code"] == code, error
    assert error["cure"]
    assert said in answer.stderr
    assert listing(folder) == before
