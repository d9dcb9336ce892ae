"""A run foreseen: the very findings that it will ask for, and nothing written."""

from __future__ import annotations

import json
import shutil
import tracemalloc
from dataclasses import replace
from math import inf
from pathlib import Path
from types import SimpleNamespace

import pytest
from once import figures_in_words
from small_job import JOB, command, listing, write_job

import maskfab as mf
from maskfab.base.errors import OutputError
from maskfab.base.findings import FINDINGS, expected, function_of
from maskfab.findings.scene import measure_scene
from maskfab.mask.comparison.roundtrip import compare_layout
from maskfab.mask.job import load_job
from maskfab.report.pages.front import shown_count
from maskfab.runs import pipeline
from maskfab.runs.forecast import _FILES, PROBE_S, STARTED_S, Amounts, Forecast, Pace, Stage, dry_run, probe, read_bytes
from maskfab.runs.store import Entry, Store

pytestmark = pytest.mark.usefixtures("drawn_in_words", "read_here")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Store]:
    """A small plate that was made with an empty cache: its folder, and what is kept."""
    folder = tmp_path_factory.mktemp("foreseen")
    (folder / "cache").mkdir(mode=0o700)
    with figures_in_words():
        pipeline.run(write_job(folder), folder / "out", cache=Store(folder / "cache"))
    return folder, Store(folder / "cache")


def test_what_is_foreseen_as_kept_is_taken(made, tmp_path):
    """Of a plate with another title every finding about a die is kept; a run of it takes as many as were told."""
    folder, store = made
    job = folder / "titled.toml"
    job.write_text((folder / "job.toml").read_text().replace("SMALL PLATE", "ANOTHER"))
    before = listing(folder)
    told = dry_run(load_job(job), tmp_path / "new" / "out", cache=store)
    assert listing(folder) == before
    assert listing(tmp_path) == {}
    stages = {stage.name: stage for stage in told.stages}
    for name in ("photographs", "optics"):
        assert (stages[name].kept, stages[name].tasks, stages[name].seconds) == (2, 2, 0.0)
    assert stages["figures"].kept is None
    taken = {}
    pipeline.run(job, tmp_path / "out", cache=store, progress=lambda *said: taken.update({said[0]: said[1:]}))
    for name in ("photographs", "optics"):
        assert taken[f"{name} taken from the cache"] == (2, 2)


def test_an_empty_cache_keeps_nothing_and_all_takes_time(made, tmp_path):
    folder, _ = made
    stages = {stage.name: stage for stage in dry_run(load_job(folder / "job.toml"), tmp_path / "out").stages}
    assert list(stages) == ["layout", "photographs", "draw", "write", "read back", "optics", "figures"]
    assert stages["optics"].kept == 0
    assert stages["optics"].seconds > 0
    # Photographs have three colours, which this camera lacks: those of two dies take what drawing the scenes takes.
    assert stages["photographs"].seconds > 0


def test_the_longest_chain_bounds_what_cores_gain():
    """Twelve photographs of 4 s, which draw their scenes for 2 s in each process, beside 5 s of one chain."""
    stages = (
        Stage("layout", 1, 0, 1.0, 0.0, 1.0),
        Stage("photographs", 12, 0, 52.0, 0.0, 6.0, each_s=2.0),
        Stage("read back", 4, 0, 3.0, 0.0, 3.0),
        Stage("figures", 6, 0, 3.0, 0.0, 0.5),
    )
    told = Forecast(stages, 2, "", False, 24)
    assert told.chain_s == 1 + 6 + 0.5
    work = {1: 57, 2: 59, 4: 63, 16: 79, 24: 79}
    for cores, all_s in work.items():
        assert told.on(cores) == pytest.approx(STARTED_S + 7.5 + (all_s - 7.5) / cores)
    assert told.on(64) == told.on(24)
    assert told.wall_s == told.on(2)
    assert f"on 16 cores {told.on(16):.1f} s" in str(told)


def test_the_command_tells_a_whole_run_and_refuses_what_a_run_refuses(made, tmp_path, monkeypatch, capsys):
    folder, store = made
    monkeypatch.setenv("MASKFAB_CACHE", str(store.folder))
    whole = command(capsys, "run", folder / "job.toml", "--out", tmp_path / "x", "--dry-run", "--json")
    assert (whole.code, whole.document["whole"], whole.document["stages"]) == (0, True, [])
    anew = command(capsys, "run", folder / "job.toml", "--out", tmp_path / "x", "--dry-run", "--no-cache")
    assert (anew.code, "read back" in anew.stdout) == (0, True)
    refused = command(capsys, "run", folder / "job.toml", "--out", folder / "out", "--dry-run")
    assert (refused.code, "MF402" in refused.stderr) == (2, True)
    with pytest.raises(OutputError, match="not empty"):
        mf.forecast(folder / "job.toml", out=folder / "out")
    assert mf.forecast(folder / "job.toml", out=folder / "out", force=True).whole
    again = command(capsys, "run", folder / "job.toml", "--out", tmp_path / "x")
    assert again.stderr.splitlines()[-1].startswith("the whole run taken from the cache, found since 20")


def test_every_model_is_of_a_function_that_there_is():
    for finding in FINDINGS:
        drawn = [name for name, _ in finding.figures]
        for name in (*finding.functions, *([] if finding.sweep is None else [finding.sweep]), *drawn):
            assert callable(function_of(name))
    assert {".gds", ".oas", "_R12.dxf", "_R2010.dxf"} <= set(_FILES)


def test_earlier_tasks_set_the_pace():
    def entry(what: str, seconds: float | None, expected_s: float | None) -> Entry:
        return Entry(Path(), what, 1, 0.0, seconds, expected_s)

    pace = Pace.of([entry("a", 2.0, 1.0), entry("a", 4.0, 1.0), entry("b", 1.0, 2.0), entry("c", 9.0, None)])
    assert (pace.of_kind, pace.of_all) == ({"a": 3.0, "b": 0.5}, 7 / 4)
    assert "3 earlier tasks" in pace.source


def test_the_probe_is_short():
    assert 0 < probe() < 20 * PROBE_S


def test_what_a_task_took_is_kept_with_it(made):
    _, store = made
    told = {entry.what: entry for entry in store.entries()}
    optics = told["findings.optics.measure_with_bar"]
    assert 0 < optics.seconds < 30
    assert 0 < optics.expected_s < 30
    assert told["run"].seconds is None
    assert json.loads(optics.path.read_bytes()[64:].partition(b"\n")[0])["form"] == 2


def test_a_scene_takes_the_psfs_that_it_shows():
    """Of every field of 25 places, of every depth one, and one more that leaves nothing out."""
    die, camera, plan = SimpleNamespace(), SimpleNamespace(window_um=256.0, pixel_um=2.0), _plan(places=3, defocus=True)
    deep = SimpleNamespace(nearest_um=1e6, focus_um=inf, farthest_um=inf, field_um=1e3, bands=())
    one = plan.price.seconds / (3 * 2 * 9)
    took = expected(measure_scene, (die, camera, deep, None, plan))
    assert took == pytest.approx(0.2 + 0.75 * one * (2 + 2 + 25))
    near = SimpleNamespace(**vars(deep) | {"field_um": 0.0, "bands": ("red", "green", "blue")})
    assert expected(measure_scene, (die, camera, near, None, plan)) == pytest.approx(0.2 + 0.75 * one * (2 + 2 + 3))


def _plan(places: int, defocus: bool) -> SimpleNamespace:
    choice = SimpleNamespace(places=places, defocus=defocus, oblique=False, samples_per_dot=0)
    return SimpleNamespace(
        choice=choice, fullest=choice, wavelengths=3, depths=1 + defocus, price=SimpleNamespace(seconds=54.0)
    )


@pytest.mark.parametrize("cells", [30, 60])
def test_memory_of_reading_is_foreseen_within_a_factor_of_two(tmp_path, cells):
    """Of what arrays hold while a die is compared dot by dot, which is most of it where dies are large."""
    edits = ("560 um", f"{56 * cells} um"), ('die_pitch = "2 mm"', 'die_pitch = "6 mm"')
    job = load_job(write_job(tmp_path, *edits))
    plate = job.plate()
    plate = replace(plate, dies=plate.dies[1:])
    made = pipeline.draw_files(job, plate)
    amounts = Amounts.of(made)
    assert amounts.dots == (7 * cells) ** 2
    tracemalloc.start()
    try:
        trip = compare_layout(plate, made.design, made.design, tmp_path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert trip.dies[0].wrong_dots == 0
    foreseen = read_bytes(made, amounts) - read_bytes(made, replace(amounts, dots=0, drawn=0))
    assert peak / 2 < foreseen < 2 * peak


def test_a_plate_of_many_dies_is_foreseen_with_the_figures_that_its_page_shows(tmp_path):
    head, first, _ = JOB.split("[[die]]")
    head = head.replace("columns = 2", "columns = 7").replace('die_pitch = "2 mm"', 'die_pitch = "1.4 mm"')
    dies = "".join("[[die]]" + first.replace("PLAIN", f"D{number}") for number in range(40))
    path = write_job(tmp_path)
    path.write_text(head + dies, encoding="utf-8")
    stages = {stage.name: stage for stage in dry_run(load_job(path), tmp_path / "out").stages}
    assert stages["figures"].tasks == 2 + shown_count(40) < 42
    assert stages["optics"].tasks == 40


def test_dies_too_fine_for_photographs_are_told_before_the_run(made, monkeypatch, tmp_path):
    """A limit below the dots of either die: none is photographed, and nothing is counted for it."""
    monkeypatch.setattr("maskfab.camera.die_transfer.MOST_ACROSS", 10)
    (stage,) = (s for s in dry_run(load_job(made[0] / "job.toml"), tmp_path / "out").stages if s.name == "photographs")
    assert stage.seconds == 0.0
    assert stage.note.startswith("none of ")


def test_what_a_run_refuses_of_a_display_is_refused_of_its_forecast(made, capsys, tmp_path):
    job = tmp_path / "job.toml"
    shutil.copytree(made[0], tmp_path, dirs_exist_ok=True, ignore=shutil.ignore_patterns("out", "cache"))
    rules = '[emitters]\ngap_to_opening = "4.001 um"\ncolour_gap = "8 um"\nmin_width = "8 um"\n\n[plate]'
    job.write_text(job.read_text().replace("[plate]", rules, 1))
    told = [command(capsys, "run", job, "--out", tmp_path / "new", "--json", *more) for more in ((), ("--dry-run",))]
    assert [answer.document["error"]["code"] for answer in told] == ["MF118", "MF118"]
