"""A design and advice are told beforehand: nothing is done, and what they would refuse is refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from small_job import command

import maskfab as mf
from maskfab.api import advising, designing
from maskfab.base.errors import InputError
from maskfab.job.toml import loads

LAYOUTS = Path(__file__).parents[2] / "layouts"
FITS, PARETO = LAYOUTS / "display_that_fits.toml", LAYOUTS / "pareto.toml"
ANSWERS = {"pitch": "460 dpi", "camera": "5.4 mm f/1.8 1.0 um"}


@pytest.fixture(autouse=True)
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*_: object, **__: object) -> None:
        raise AssertionError("work was done")

    for room, name in ((advising, "advise_spec"), (designing, "design_spec"), (designing, "sweep")):
        monkeypatch.setattr(room, name, never)


def test_a_design_is_told_beforehand(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    out = tmp_path / "out"
    told = command(capsys, "design", FITS, "-o", out, "--dry-run", "--json", "--budget", "40 s").document
    assert told["budget_s"] == 40
    assert told["makes"] == [str(out / name) for name in ("fits.toml", "fits_map.toml", "design.json", "design.html")]
    assert "for an opening" in told["work"]
    assert not out.exists()
    assert "not estimated" in str(mf.design(FITS, dry_run=True))


def test_a_front_is_told_beforehand(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    told = command(capsys, "design", PARETO, "--front", "-o", tmp_path / "out", "--dry-run", "--json").document
    assert "80 and 100 and 120 clear dots" in told["work"]
    assert list(tmp_path.iterdir()) == []


def test_advice_from_answers_shows_the_job_and_what_moved() -> None:
    told = mf.advise(answers=ANSWERS, dry_run=True)
    assert told.budget_s == 40
    assert any("pitch 55.217 um -> 55 um" in note for note in told.notes)
    assert loads(told.job)["design"]["pitch"] == "55 um"
    assert told.job in str(told)
    json.dumps(told.to_dict())


def test_advice_needs_no_folder_to_be_told_beforehand(capsys: pytest.CaptureFixture[str]) -> None:
    assert "takes: 40 s" in command(capsys, "advise", FITS, "--dry-run").stdout


@pytest.mark.parametrize(
    ("verb", "edit", "code"),
    [
        (mf.advise, ("", ""), "MF301"),  # the opening of the die to compare with lies elsewhere
        (mf.design, ("clear_dots = 100", "clear_dots = 100\npositions = 2"), "MF123"),
        (mf.design, ("pixel =", "glass = 'none'\npixel ="), "MF102"),
    ],
)
def test_what_would_be_refused_is_refused_beforehand(
    tmp_path: Path, verb: object, edit: tuple[str, str], code: str
) -> None:
    job = tmp_path / "job.toml"
    job.write_text(FITS.read_text(encoding="utf-8").replace(*edit), encoding="utf-8")
    with pytest.raises(InputError, match=code):
        verb(job, dry_run=True)  # type: ignore[operator]


@pytest.mark.parametrize("verb", [mf.design, mf.advise])
def test_photographs_that_there_are_not_are_refused_beforehand(verb: object, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="MF301"):
        verb(FITS, images=tmp_path / "none", dry_run=True)  # type: ignore[operator]


def test_places_are_looked_at_beforehand(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("")
    for verb in ("design", "advise"):
        assert "MF402" in command(capsys, verb, FITS, "-o", tmp_path, "--dry-run").stderr
