"""Progress in a notebook: one line, for what takes more than two seconds, and nowhere else."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace

import pytest

from maskfab.base.checks import checked_arguments
from maskfab.base.work import NotebookLine, Progress, silent


class Cell:
    """Output of a cell of a notebook: its lines, of which each may be updated."""

    def __init__(self) -> None:
        self.lines: list[list[str]] = []

    def display(self, shown: dict[str, str], *, raw: bool, display_id: bool) -> SimpleNamespace:
        assert raw
        assert display_id
        line = [shown["text/plain"]]
        self.lines.append(line)
        return SimpleNamespace(update=lambda shown, raw: line.append(shown["text/plain"]))


@pytest.fixture
def notebook(monkeypatch) -> Cell:
    """A fake kernel of IPython, whose clock goes a second at every look."""
    cell, package, display = Cell(), ModuleType("IPython"), ModuleType("IPython.display")
    package.get_ipython = lambda: SimpleNamespace(kernel=object())  # type: ignore[attr-defined]
    display.display = cell.display  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", display)
    seconds = iter(range(1000))
    made = NotebookLine.__init__
    monkeypatch.setattr(
        NotebookLine, "__init__", lambda self, name, shown: made(self, name, shown, lambda: float(next(seconds)))
    )
    return cell


@checked_arguments
def work(steps: int, *, progress: Progress = silent) -> None:
    for done in range(steps):
        progress("dies", done, steps)


def test_a_notebook_shows_one_line_of_long_work_and_updates_it(notebook):
    work(4)
    assert notebook.lines == [
        ["work: dies 1/4, 2 s", "work: dies 2/4, 3 s", "work: dies 3/4, 4 s", "work: done in 5 s"]
    ]


def test_short_work_and_work_whose_progress_is_asked_for_show_nothing(notebook):
    work(1)
    told = []
    work(5, progress=lambda *step: told.append(step))
    assert (notebook.lines, len(told)) == ([], 5)


@pytest.mark.parametrize("shell", [None, SimpleNamespace()], ids=["a script", "a terminal"])
def test_scripts_and_terminals_show_nothing(notebook, monkeypatch, shell):
    monkeypatch.setattr(sys.modules["IPython"], "get_ipython", lambda: shell)
    work(5)
    assert notebook.lines == []
