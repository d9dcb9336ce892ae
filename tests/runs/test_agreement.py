"""Page, table and report.json of a run: one that is wrong alone is told before the folder has its name."""

from __future__ import annotations

import json
import re

import pytest
from small_job import finished, write_job

from maskfab.base.errors import InternalError
from maskfab.report.documents import numbers
from maskfab.report.pages import template
from maskfab.runs import pipeline
from maskfab.runs.agreement import check_agreement


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return finished(tmp_path_factory.mktemp("agreement"))


def by_half(text):
    return repr(1.5 * float(text))


WRONG = {
    "table": ("numbers.csv", r"(?<=mtf50,ν50,)[\d.]+"),
    "exact": (
        "appendix.html",
        r'(?<=<td title="mtf50">MTF50</td>\n<td class="mark">ν50</td>\n<td class="n" title=")[\d.]+',
    ),
    "shown": ("appendix.html", r"(?<= cy/mm\">)[\d.]+"),
    "page": ("report.html", r'(?<=<td title="mtf50">MTF50</td><td class="n" title=")[\d.]+'),
}


@pytest.mark.parametrize("what", WRONG)
def test_a_number_that_is_wrong_in_one_place_is_told(what, folder, tmp_path):
    name, pattern = WRONG[what]
    for each in (path.name for path in folder.iterdir()):
        (tmp_path / each).write_bytes((folder / each).read_bytes())
    assert check_agreement(tmp_path) > 100
    text, count = re.subn(pattern, lambda found: by_half(found[0]), (tmp_path / name).read_text("utf-8"), count=1)
    assert count == 1
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(InternalError, match=rf"MF329 .*{name}"):
        check_agreement(tmp_path)


def test_a_report_that_is_wrong_alone_is_told(folder, tmp_path):
    for each in (path.name for path in folder.iterdir() if path.name != "report.json"):
        (tmp_path / each).write_bytes((folder / each).read_bytes())
    report = json.loads((folder / "report.json").read_text("utf-8"))
    (row, *_) = (row for row in report["dies"][0]["quantities"] if row["name"] == "open_ratio")
    row["value"] *= 1.5
    (tmp_path / "report.json").write_text(json.dumps(report), encoding="utf-8")
    with pytest.raises(InternalError, match="MF329"):
        check_agreement(tmp_path)


@pytest.mark.parametrize(("owner", "name"), [(numbers, "_cell"), (template, "value_and_error")])
@pytest.mark.usefixtures("drawn_in_words")
def test_a_run_whose_writer_is_wrong_leaves_nothing(owner, name, monkeypatch, tmp_path):
    true = getattr(owner, name)

    def wrong(value, *more, **options):
        return true(1.5 * value if isinstance(value, float) else value, *more, **options)

    monkeypatch.setattr(owner, name, wrong)
    with pytest.raises(InternalError, match="MF329"):
        pipeline.run(write_job(tmp_path), tmp_path / "out")
    assert not (tmp_path / "out").exists()
