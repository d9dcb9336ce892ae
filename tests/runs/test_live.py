"""A run tells of its dies while it goes on: by lines, and by a page that ends with the report or with the reason."""

from __future__ import annotations

import math
import re
import shutil

import pytest
from small_job import write_job

from maskfab.base.errors import OutputError
from maskfab.base.work import silent
from maskfab.runs import live, pipeline
from maskfab.runs.live import Live
from maskfab.runs.store import Store

pytestmark = pytest.mark.usefixtures("read_here")
ONE_FILE = ("[plate]", '[export]\nformats = ["gdsii"]\n\n[plate]')


def test_dies_are_told_of_before_the_report_is_drawn(tmp_path):
    page, told, seen = tmp_path / "live.html", [], {}

    def progress(stage: str, done: int, total: int) -> None:
        told.append((stage, total))
        if page.exists() and not done:
            seen.setdefault(stage, page.read_text())

    pipeline.run(write_job(tmp_path, ONE_FILE), tmp_path / "out", progress=progress, live=page)
    words = [stage for stage, total in told if not total]
    for die in ("PLAIN", "TURNED"):
        assert next(line for line in words if line.startswith(f"{die}: ")).startswith(f"{die}: 30.6% clear, ring, ")
        assert any(re.fullmatch(rf"{die}: worst MTF 0\.\d+ on average at 530 nm", line) for line in words)
        assert any(line.startswith(f"{die}: no photographs: MF134") for line in words)
    assert told.index((words[0], 0)) < told.index(next(item for item in told if item[0] == "write files"))
    assert max(told.index((line, 0)) for line in words) < told.index(("figures", 1))
    early, last = seen["read back"], page.read_text()
    assert 'http-equiv="refresh"' in early
    assert "PLAIN" in early
    assert "worst MTF" not in early
    assert 'http-equiv="refresh"' not in last
    assert '<a href="out/report.html">' in last
    assert last.count("<img") == 4
    assert "worst MTF" in last


def test_of_many_dies_the_page_alone_tells_and_is_not_written_for_each(tmp_path, monkeypatch):
    monkeypatch.setattr(live, "_MOST_TOLD", 1)
    monkeypatch.setattr(live, "_EVERY_S", math.inf)
    written, write, told = [], live.write_text, []
    monkeypatch.setattr(live, "write_text", lambda page, text: written.append(text) or write(page, text))
    page = tmp_path / "live.html"
    pipeline.run(write_job(tmp_path, ONE_FILE), tmp_path / "out", progress=lambda *step: told.append(step), live=page)
    assert [stage for stage, _, total in told if not total] == []
    assert len(written) <= 1 + len({stage for stage, *_ in told}) + 1
    assert page.read_text().count("worst MTF") == 2


def test_a_run_that_was_kept_shows_its_dies_too(tmp_path):
    (tmp_path / "kept").mkdir(mode=0o700)
    job, page, kept = write_job(tmp_path, ONE_FILE), tmp_path / "live.html", Store(tmp_path / "kept")
    pipeline.run(job, tmp_path / "out", cache=kept)
    again = pipeline.run(job, tmp_path / "again", cache=kept, live=page)
    assert again.taken == (1, 1)
    assert "30.6% clear, ring, random" in page.read_text()


def test_a_run_that_fails_says_so_on_its_page(tmp_path, monkeypatch):
    def refused(*_: object) -> None:
        raise OutputError("MF401", "the disk is full", where="out", cure="Make room")

    monkeypatch.setattr(pipeline, "write_files", refused)
    with pytest.raises(OutputError):
        pipeline.run(write_job(tmp_path, ONE_FILE), tmp_path / "out", live=tmp_path / "live.html")
    page = (tmp_path / "live.html").read_text()
    assert "Stopped: MF401 the disk is full" in page
    assert "refresh" not in page


def test_a_page_that_is_there_is_replaced_by_force_alone(tmp_path):
    page = tmp_path / "live.html"
    page.write_text("mine")
    with pytest.raises(OutputError, match="MF402"):
        pipeline.run(write_job(tmp_path, ONE_FILE), tmp_path / "out", live=page)
    assert page.read_text() == "mine"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("name", "said"),
    [("out/live.html", "lies in the run's directory"), ("out/report.html", "lies in the run"), ("job.toml", "no page")],
)
def test_a_page_is_refused_where_it_spoils_a_run(tmp_path, name, said):
    job, page = write_job(tmp_path, ONE_FILE), tmp_path / name
    pipeline.run(job, tmp_path / "out")
    before = page.read_bytes() if page.exists() else None
    with pytest.raises(OutputError, match=said) as caught:
        pipeline.run(job, tmp_path / "out", force=True, live=page)
    assert caught.value.code == "MF401"
    assert "--live" in str(caught.value)
    assert (page.read_bytes() if page.exists() else None) == before


def test_a_page_that_cannot_be_written_on_ends_no_run(tmp_path):
    (tmp_path / "pages").mkdir()

    def progress(stage: str, done: int, total: int) -> None:
        if stage == "write files":
            shutil.rmtree(tmp_path / "pages", ignore_errors=True)

    pipeline.run(write_job(tmp_path, ONE_FILE), tmp_path / "out", progress=progress, live=tmp_path / "pages/live.html")
    assert (tmp_path / "out/report.html").exists()


def test_a_run_that_is_ended_says_so(tmp_path):
    page = tmp_path / "live.html"
    with pytest.raises(KeyboardInterrupt), Live(silent, tmp_path / "out", page):
        raise KeyboardInterrupt
    assert "Stopped: from outside." in page.read_text()
