"""The examples end in a picture each, and those in docstrings give what they say."""

from __future__ import annotations

import doctest
import re
import runpy
from importlib import import_module
from pathlib import Path

import pytest

import maskfab as mf

EXAMPLES = sorted((Path(mf.__file__).parents[1] / "examples").glob("*.py"))
STARTS = {".png": b"\x89PNG\r\n\x1a\n", ".svg": b"<svg"}


def test_there_are_examples_and_each_is_short():
    assert len(EXAMPLES) >= 6
    assert all(len(path.read_text().splitlines()) <= 42 for path in EXAMPLES)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_in_an_empty_folder_and_ends_in_a_picture(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STEPS", "3")
    runpy.run_path(str(path), run_name="__main__")
    drawn = [file for file in tmp_path.iterdir() if file.suffix in STARTS]
    assert drawn
    for file in drawn:
        assert file.read_bytes().startswith(STARTS[file.suffix])


def documented() -> list[doctest.DocTest]:
    """Examples of every public name, each with the module that it stands in."""
    finder, found = doctest.DocTestFinder(), []
    modules = {room for room in mf.WHERE.values() if room != "maskfab.api"} | {
        "maskfab",
        "maskfab.api.order",
        "maskfab.api.torch",
    }
    for name in sorted(modules):
        found += [test for test in finder.find(import_module(name)) if test.examples]
    return found


def test_examples_in_docstrings_give_what_they_say():
    tests = documented()
    assert {"maskfab.api.opening.Opening", "maskfab.api.panel.Panel", "maskfab.api.plate.Plate"} <= {
        test.name for test in tests
    }
    runner = doctest.DocTestRunner()
    for test in tests:
        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0
    assert runner.tries >= 12


def test_every_table_of_the_manual_is_made_and_has_its_place():
    docs = Path(mf.__file__).parents[1] / "docs"
    made = runpy.run_path(str(docs / "tables.py"))["_MADE"]
    marked = {mark for page in docs.rglob("*.md") for mark in re.findall(r"<!-- (\w+) -->", page.read_text("utf-8"))}
    assert marked == set(made)
    for lines in made.values():
        assert len("\n".join(lines())) > 1000
