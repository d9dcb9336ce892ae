"""A plate small enough for every test, with everything that can go wrong on a large one."""

from __future__ import annotations

import gc
import multiprocessing
import os
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import copies
import numpy as np
import pytest
from browser import Browser, Chromium, Firefox
from hypothesis import settings
from once import (
    BOUNDS,
    DESIGN,
    OPTICS,
    compared_once,
    dimmed,
    figures_in_words,
    leaves,
    once,
    small_scenes,
    statistics,
)
from small_job import finished, write_job

from maskfab.base.model import CLEAR, OUTLINE, Die, Gauge, Mark, Note, Opening, Panel, Plate, Tiling
from maskfab.camera import scenes
from maskfab.camera.inspection import costs
from maskfab.designs.model import layouts_bound, limits
from maskfab.designs.model.statistics import SceneStatistics
from maskfab.findings import bands, photographs
from maskfab.mask import sandbox
from maskfab.mask.formats import gdsii
from maskfab.mask.formats.gdsii import write_gdsii
from maskfab.mask.formats.gdstk_process import content
from maskfab.mask.job import Job, load_job
from maskfab.mask.layout import plate_layout
from maskfab.mask.outlines import text_polygons
from maskfab.runs.store import VARIABLE

# The same examples in every run: a red test is the fault of a change. HYPOTHESIS_PROFILE=explore looks for new ones.
settings.register_profile("fixed", max_examples=15, derandomize=True, deadline=None)
settings.register_profile("full", max_examples=100, derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=500, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def pytest_collection_finish() -> None:
    """What libraries hold stays to the end: each look of the garbage collector at all of it takes half a second.

    Some are imported later, so that looks are rarer too.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)


def pytest_unconfigure() -> None:
    gc.unfreeze()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Files go to workers one by one, and together, first of all, those that look at pages.

    Browsers are then started by one worker.
    """
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "pages" if _looks_at_pages(config.rootpath / file) else file

    return Scheduling(config, log) if config.getoption("dist") == "loadfile" else None


@cache
def _looks_at_pages(path: Path) -> bool:
    return re.search("browser|chromium|firefox", path.read_text(encoding="utf-8")) is not None


@pytest.fixture(scope="session")
def small_plate() -> Plate:
    """Three dies: periodic with a gutter, random without one, random with the same opening as the first.

    The openings have holes and kissing corners. Marks: a title, an outline and one CD bar of 2 µm with its gauge.
    """
    rng = np.random.default_rng(7)
    ring = np.zeros((7, 7), dtype=np.bool_)
    ring[1:6, 1:5] = True
    ring[3, 2] = ring[4, 3] = False
    ring[0, 0] = ring[6, 5] = True
    noise = rng.random((9, 9)) < 0.4
    openings = Opening("ring", ring, 8000), Opening("do-main", noise, 4030)

    def die(name: str, opening: Opening, gutter_nm: int, tiling: Tiling, centre_nm: tuple[int, int]) -> Die:
        seed = None if tiling is Tiling.PERIODIC else 1
        turns = np.full((4, 5), 3) if seed is None else rng.integers(0, 8, (4, 5))
        panel = Panel(opening, opening.dot_nm, gutter_nm, turns, tiling, seed)
        return Die(name, name.lower(), panel, centre_nm, 400_000)

    bar = ((2_000_000, 0), (2_000_000, 100_000), (2_002_000, 100_000), (2_002_000, 0))
    frame = ((-5_000_000, -5_000_000), (-5_000_000, 5_000_000), (5_000_000, 5_000_000), (5_000_000, -5_000_000))
    return Plate(
        name="small plate",
        title="A small plate",
        blank_nm=10_000_000,
        writable_nm=9_000_000,
        dies=(
            die("PERIODIC", openings[0], 8000, Tiling.PERIODIC, (-1_000_000, 0)),
            die("DENSE", openings[1], 0, Tiling.RANDOM, (1, 1)),
            die("RANDOM", openings[0], 8000, Tiling.RANDOM, (1_000_000, 0)),
        ),
        marks=(
            Mark("TITLE", "title", CLEAR, text_polygons("Plate 08 B%", 200_000, (0, 3_000_000), "centre")),
            Mark("FRAME", "outline", OUTLINE, (frame,)),
            Mark("CD_2UM", "cd", CLEAR, (bar,)),
        ),
        gauges=(
            Gauge("cd_x_2um", "x", (2_001_000, 50_000), 5_000, 2_000),
            Gauge("cd_y_100um", "y", (2_001_000, 50_000), 60_000, 100_000),
        ),
        notes=(Note("job 0123abcd", (0, -4_000_000)),),
    )


@pytest.fixture(scope="session", autouse=True)
def scenes_drawn_once() -> Iterator[None]:
    """The scenes of whoever has no photographs, a second each, which every run and every search would draw again; a run
    has small ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "dead_leaves", leaves)
        patch.setattr(scenes, "indoors", dimmed)
        patch.setattr(SceneStatistics, "of", statistics)
        for each in (photographs, bands):
            patch.setattr(each, "drawn_scenes", small_scenes)
        yield


@pytest.fixture(scope="session", autouse=True)
def nothing_kept() -> Iterator[None]:
    """A run finds everything anew, unless a test is about what is kept."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(VARIABLE, "off")
        yield


@pytest.fixture(scope="session", autouse=True)
def readers_in_copies() -> Iterator[None]:
    """The scripts that read a file apart, in a copy of this process instead of a new one."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sandbox, "subprocess", copies.FORKING)
        yield


@pytest.fixture
def drawn_in_words() -> Iterator[None]:
    """For tests that are about something else than figures."""
    with figures_in_words():
        yield


@pytest.fixture
def verified_once() -> Iterator[None]:
    """For tests that verify copies of one result, most of whose files are as they were."""
    with compared_once(), once(*OPTICS):
        yield


@pytest.fixture
def measured_once() -> Iterator[None]:
    """For tests that are about something else than the optics of a die."""
    with once(*OPTICS):
        yield


@pytest.fixture
def design_once() -> Iterator[None]:
    """For tests that hold many files against one design."""
    with once(*DESIGN):
        yield


@pytest.fixture(scope="module")
def costs_of_two_scenes() -> Iterator[None]:
    """As few photographs as have a spread, of those by which costs of a capture are told."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(costs, "_SCENES", costs._SCENES[:2])
        patch.setattr(costs, "_scenes", cache(costs._scenes.__wrapped__))
        yield


@pytest.fixture
def bound_once() -> Iterator[None]:
    """For tests that are about something else than the bounds of an opening."""
    with once(*BOUNDS):
        yield


@pytest.fixture
def bound_loosely(monkeypatch) -> None:
    """For tests that ask for no bound of a unit: that of an open stop, which is quick, stands for those below it."""

    def of_open_stop(inner, ratio, levels=None) -> tuple[float, ...]:
        return inner.psnr(inner.stop, ratio, 1.0, levels)

    def limit(inner, light, level) -> float:
        return of_open_stop(inner, light.total / inner.stop_dots, (level,))[0]

    def errors(inner, classes, ratio, variances, *, periodic) -> list[float]:
        return [
            10 ** ((inner.decibels(level, 1.0) - psnr) / 10)
            for level, psnr in zip(inner.levels, of_open_stop(inner, ratio), strict=True)
        ]

    monkeypatch.setattr(limits, "residue_errors", errors)
    monkeypatch.setattr(layouts_bound, "layout_limit", limit)


@pytest.fixture
def bound_closely(bound_loosely, monkeypatch) -> Iterator[None]:
    """For a test among those that asks for the bounds all the same."""
    monkeypatch.undo()
    with once(*BOUNDS):
        yield


@pytest.fixture
def read_here(monkeypatch) -> None:
    """For tests of whole files that are about something else than the process that reads them, and its limits."""
    monkeypatch.setattr(gdsii, "_read_cells", lambda path, function, _: content(function, str(path)))
    monkeypatch.setattr(sandbox, "multiprocessing", SimpleNamespace(get_all_start_methods=list))


@pytest.fixture
def within_limits(read_here, monkeypatch) -> None:
    """For a test among those that is about the limits."""
    monkeypatch.setattr(sandbox, "multiprocessing", multiprocessing)


@pytest.fixture(scope="session")
def chromium(tmp_path_factory) -> Iterator[Chromium]:
    """Started once, for all that is looked at."""
    browser = Chromium.started(tmp_path_factory.mktemp("browsers"))
    yield browser
    browser.close()


@pytest.fixture(scope="session")
def firefox(tmp_path_factory) -> Iterator[Firefox]:
    """Started once, for all that is looked at."""
    browser = Firefox.started(tmp_path_factory.mktemp("browsers"))
    yield browser
    browser.close()


@pytest.fixture(scope="module", params=["chromium", "firefox"])
def browser(request) -> Browser:
    """One after the other; by module, lest tests of others, and what they share, be made twice."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def small_result(tmp_path_factory) -> Path:
    """The output directory of the small job as it stands; tests copy what they change."""
    return finished(tmp_path_factory.mktemp("small"))


@pytest.fixture(scope="module")
def job(tmp_path_factory) -> Job:
    return load_job(write_job(tmp_path_factory.mktemp("job")))


@pytest.fixture(scope="module")
def plate(job) -> Plate:
    return job.plate()


@pytest.fixture(scope="module")
def gds(plate, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("gds") / "plate.gds"
    write_gdsii(plate_layout(plate), path)
    return path
