"""Figures drawn by several processes."""

from __future__ import annotations

import math
from types import MappingProxyType

import pytest

from maskfab.errors import InternalError
from maskfab.report.data import to_document
from maskfab.report.plots import die_figures
from maskfab.report.plots.workers import draw_all


def test_how_many_processes_draw_does_not_show(run) -> None:
    document = to_document(run.report, run.plate, run.camera)
    more = [(item.die.name, (dict, ({"more": item.die.label},))) for item in run.optics]
    alone = die_figures.pictures(run.plate, run.optics, document, more)
    assert die_figures.pictures(run.plate, run.optics, document, more, workers=2) == alone
    assert {name: drawings.get("more") for name, drawings in alone.items() if name != die_figures.PLATE} == {
        item.die.name: item.die.label for item in run.optics
    }


@pytest.mark.parametrize("workers", [1, 2, 3, 7])
def test_tasks_keep_their_order_and_may_be_fewer_than_processes(workers: int) -> None:
    tasks = [(dict, (MappingProxyType({"number": str(k)}),)) for k in range(5)]
    assert draw_all(tasks, workers) == [{"number": str(k)} for k in range(5)]


def test_a_process_that_fails_is_told_with_its_last_words() -> None:
    with pytest.raises(InternalError, match="ended with ValueError: math domain error"):
        draw_all([(dict, ({},)), (math.sqrt, (-1.0,))], 2)
