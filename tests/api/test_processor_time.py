"""The processor time that a verb tells counts every process that it waited for."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest
from shared_tasks import busy

import maskfab as mf
from maskfab.api import advising, designing
from maskfab.base import workers
from maskfab.base.effort import add_helper, measured
from maskfab.base.processes import Call, ProcessExecutor

LAYOUTS = Path(__file__).parents[2] / "layouts"
BUSY_S = 0.7


def shared(*_: Any, executor: Any = None, **__: Any) -> Any:
    """Work of another process alone."""
    if executor is None:
        with ProcessExecutor() as pair:
            return shared(executor=pair)
    task = executor.submit(Call(busy, lambda: (BUSY_S,)))
    while not task.ended:
        time.sleep(0.01)
    assert task.result() != os.getpid()
    return None


@pytest.fixture(autouse=True)
def two_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]), prepend=os.pathsep)
    monkeypatch.setattr(workers, "cores", lambda: 2)


def test_advice_counts_the_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(advising, "advise_spec", shared)
    assert mf.advise(LAYOUTS / "display_that_fits.toml").time["processor_s"] >= BUSY_S


def test_a_design_counts_the_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(designing, "design_spec", shared)
    made = mf.design(LAYOUTS / "display_that_fits.toml").made
    assert made is not None
    assert made.processor_s >= BUSY_S


def test_work_within_work_counts_its_helpers_to_both() -> None:
    with measured() as whole, measured() as part:
        add_helper(2.0)
    assert part.seconds == pytest.approx(2.0, abs=0.2)
    assert whole.seconds == pytest.approx(2.0, abs=0.2)
