"""Sweeps from a study file to their table: engines, resuming, cases that fail, and what a study may not ask."""

from __future__ import annotations

import csv
import json
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from browser import faults
from small_job import command, write_job

import maskfab as mf
from maskfab.api.sweeping import Sweep
from maskfab.base import resources
from maskfab.base.errors import JobError, MissingPackageError, OutputError
from maskfab.base.processes import LocalProcess
from maskfab.base.workers import Workers, check_version
from maskfab.runs import sweep_cases
from maskfab.runs.store import of_installation
from maskfab.runs.sweep import made
from maskfab.runs.sweep_cases import map_cases
from maskfab.runs.sweep_page import _values_text
from maskfab.runs.sweep_plan import MOST_CASES, planned

STUDY = """
[sweep]
title = "bias <b>and</b> radius"
job = "job.toml"
quantities = ["open_ratio", "written_open_ratio_fused", "written_min_feature"]
dies = ["PLAIN"]

[[field]]
key = "process.cd_bias"
values = ["-0.5 um", "0 um", "0.5 um"]

[[field]]
key = "process.corner_radius"
from = "0 um"
to = "1 um"
count = 2
"""


def write_study(folder: Path, *edits: tuple[str, str], job: tuple[tuple[str, str], ...] = ()) -> Path:
    write_job(folder, *job)
    text = STUDY
    for old, new in edits:
        assert old in text, old
        text = text.replace(old, new, 1)
    path = folder / "study.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def swept(tmp_path_factory) -> Sweep:
    folder = tmp_path_factory.mktemp("sweep")
    limit = "[limits]\nmin_feature = '7.6 um'\n\n[[die]]"
    study = write_study(folder, job=(("[[die]]", limit),))
    return mf.sweep(study, folder / "out", engine="serial")


@pytest.mark.parametrize("path", sorted(resources.path("layouts/sweeps").glob("*.toml")), ids=lambda path: path.stem)
def test_shipped_studies_load_and_all_their_cases_are_jobs(path):
    plan = planned(path)
    assert not [case.refused for case in plan.cases if case.refused]


def test_a_field_of_one_value_is_told_as_that_value():
    plan = planned(resources.path("layouts/sweeps") / "gap.toml")
    assert [_values_text(field) for field in plan.fields] == ["6 values, 0 to 1 mm", "0.5 mm", "draft"]


def test_numbers_follow_from_the_fields(swept):
    """A line of w as drawn is w + b wide as written, and rounding its corners lets less light through."""
    found = {
        tuple(case["values"]): {row["name"]: row["value"] for row in case["rows"]} for case in swept.to_dict()["cases"]
    }
    assert len(found) == 6
    for bias in (-0.5, 0, 0.5):
        sharp, round_ = found[f"{bias:g} um", "0 um"], found[f"{bias:g} um", "1 um"]
        assert sharp["written_min_feature"] == pytest.approx(8 + bias, abs=1e-9)
        assert sharp["open_ratio"] == round_["open_ratio"]
        assert sharp["written_open_ratio_fused"] != round_["written_open_ratio_fused"]


def test_roughness_is_a_field(tmp_path):
    """Twice as rough edges scatter twice as much light; a case without a correlation makes no job."""
    edits = (
        ("process.cd_bias", "process.roughness.sigma"),
        ('"-0.5 um", "0 um", "0.5 um"', '"0 um", "0.1 um", "0.2 um"'),
        (
            '"process.corner_radius"\nfrom = "0 um"\nto = "1 um"\ncount = 2',
            '"process.roughness.correlation"\nvalues = ["0.5 um"]',
        ),
        ('"open_ratio", "written_open_ratio_fused", "written_min_feature"', '"written_scattered_fused"'),
    )
    found = mf.sweep(write_study(tmp_path, *edits), tmp_path / "out", engine="serial")
    (series,) = found.found.series
    assert series.values[0] == 0
    assert series.values[2] == pytest.approx(2 * series.values[1], rel=1e-12)
    assert series.values[1] > 0
    smooth = write_study(tmp_path, *edits[3:])
    (refused, *_) = mf.sweep(smooth, tmp_path / "smooth", engine="serial").found.failed
    assert "no [process.roughness]" in refused[1]


def test_displays_that_cannot_be_count_as_no_yield(tmp_path):
    """Emitters of more than a pixel's closed part have no place; without a minimum any placement will do."""
    emitters = (
        '[emitters]\ngap_to_opening = "1 um"\ncolour_gap = "1 um"\nmin_width = "2 um"\ncircuit = "10 um^2"\n\n[[die]]'
    )
    edits = (
        ("process.cd_bias", "emitters.required"),
        ('"-0.5 um", "0 um", "0.5 um"', "0.01, 0.9"),
        ('"process.corner_radius"\nfrom = "0 um"\nto = "1 um"\ncount = 2', '"emitters.min_width"\nvalues = ["2 um"]'),
        ('"open_ratio", "written_open_ratio_fused", "written_min_feature"', '"display_fits", "led_footprint"'),
    )
    found = mf.sweep(write_study(tmp_path, *edits, job=(("[[die]]", emitters),)), tmp_path / "out", engine="serial")
    fits = next(series for series in found.found.series if series.of.name == "display_fits")
    assert fits.values.tolist() == [1, 0]
    (only,) = found.yields
    assert (only.kept, only.cases) == (1, 2)


def test_the_yield_is_of_the_jobs_limits(swept):
    (only,) = swept.yields
    assert (only.kept, only.cases) == (4, 6)
    assert only.low < 4 / 6 < only.high


def test_table_document_and_page_say_the_same(swept):
    with (swept.directory / "sweep.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    document = json.loads((swept.directory / "sweep.json").read_text(encoding="utf-8"))
    assert document == json.loads(json.dumps(swept.to_dict()))
    told = [row["value"] for case in document["cases"] for row in case["rows"]]
    assert [float(row["value"]) for row in rows] == told
    assert {row["process.cd_bias"] for row in rows} == {"-0.5 um", "0 um", "0.5 um"}
    page = (swept.directory / "sweep.html").read_text(encoding="utf-8")
    assert "<b>and</b>" not in page
    assert "//" not in page.replace("<!--", "")


def test_the_page_opens_anywhere(browser, swept):
    assert faults(browser, swept.directory / "sweep.html") == []


def test_processes_find_what_one_finds(swept, tmp_path):
    study = swept.found.plan.where
    again = mf.sweep(study, tmp_path / "out", workers=2)
    for name in ("sweep.json", "sweep.csv", "sweep.html"):
        assert (tmp_path / "out" / name).read_bytes() == (swept.directory / name).read_bytes()
    assert again.found.remade == 6


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_no_case_is_lost_with_a_worker_that_somebody_kills(swept, tmp_path, monkeypatch):
    class Killed(LocalProcess):
        """The first one is killed before it has answered anything."""

        started = 0

        def __init__(self) -> None:
            super().__init__()
            Killed.started += 1
            if Killed.started == 1:
                self.kill()

    monkeypatch.setattr("maskfab.base.processes.LocalProcess", Killed)
    again = mf.sweep(swept.found.plan.where, tmp_path / "out", workers=2)
    assert Killed.started == 2
    assert again.found.failed == ()
    assert (tmp_path / "out/sweep.json").read_bytes() == (swept.directory / "sweep.json").read_bytes()


def test_a_cluster_finds_what_one_finds(swept, tmp_path):
    distributed = pytest.importorskip("distributed", reason="dask.distributed is not installed (extra cluster)")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None
    ) as cluster:
        study = swept.found.plan.where
        mf.sweep(study, tmp_path / "out", engine="dask", scheduler=cluster.scheduler_address)
    assert (tmp_path / "out/sweep.json").read_bytes() == (swept.directory / "sweep.json").read_bytes()


def test_what_was_found_is_not_found_again(tmp_path):
    study = write_study(tmp_path, ('"open_ratio", "written_open_ratio_fused", "written_min_feature"', '"open_ratio"'))
    out = tmp_path / "out"
    first = mf.sweep(study, out, engine="serial")
    assert mf.sweep(study, out, engine="serial").found.remade == 0
    lost, damaged, strange, *_ = sorted((out / "cases").rglob("*.json"))
    lost.unlink()
    damaged.write_text(damaged.read_text()[:40])
    strange.write_text("[]")
    again = mf.sweep(study, out, engine="serial")
    assert again.found.remade == 3
    assert again.to_dict() == first.to_dict()


def test_an_interrupted_sweep_keeps_what_it_has(tmp_path):
    plan = planned(write_study(tmp_path))
    told: list[int] = []

    def interrupt(stage: str, done: int, total: int) -> None:
        told.append(done)
        if len(told) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        map_cases(plan.cases, plan.quantities, tmp_path / "cases", interrupt, Workers(1))
    assert told == [0, 1, 2, 3]
    assert len(list((tmp_path / "cases").rglob("*.json"))) == 3


def test_a_number_that_is_none_fails_its_case(tmp_path, monkeypatch):
    real = sweep_cases.measured

    def measured(job, wanted):
        process = job.spec.written
        return [replace(each, value=math.nan) if process.cd_bias_um > 0 else each for each in real(job, wanted)]

    monkeypatch.setattr(sweep_cases, "measured", measured)
    study = write_study(tmp_path, ('"open_ratio", "written_open_ratio_fused", "written_min_feature"', '"open_ratio"'))
    found = mf.sweep(study, tmp_path / "out", engine="serial")
    assert [why for _, why in found.found.failed] == ["MF163 open_ratio is not finite"] * 2
    assert "MF163" in (tmp_path / "out/sweep.html").read_text(encoding="utf-8")
    assert "nan" not in (tmp_path / "out/sweep.json").read_text(encoding="utf-8").lower()


def test_a_case_that_is_refused_is_told_and_the_others_are_found(tmp_path, capsys):
    study = write_study(tmp_path, ('"-0.5 um", "0 um", "0.5 um"', '"0 um", "9 um"'))
    answer = command(capsys, "sweep", study, "-o", tmp_path / "out", "--engine", "serial", "--json", "--quiet")
    document = answer.document
    assert answer.code == 1
    assert [each["why"][:5] for each in document["failed"]] == ["MF127"] * 2
    assert sum(bool(case["rows"]) for case in document["cases"]) == 2


def test_fields_of_every_die_and_of_files(tmp_path):
    edits = (
        ('dies = ["PLAIN"]', ""),
        ("process.cd_bias", "die.*.size"),
        ('"-0.5 um", "0 um", "0.5 um"', '"560 um", "504 um"'),
        (
            '"process.corner_radius"\nfrom = "0 um"\nto = "1 um"\ncount = 2',
            '"die.TURNED.opening"\nvalues = ["ring.toml", "dot.toml"]',
        ),
        ('"open_ratio", "written_open_ratio_fused", "written_min_feature"', '"open_ratio"'),
    )
    study = write_study(tmp_path, *edits)
    ring = (tmp_path / "ring.toml").read_text()
    (tmp_path / "dot.toml").write_text(ring.replace('"ring"', '"dot"').replace(".##.#..", ".##...."))
    found = mf.sweep(study, tmp_path / "out", engine="serial")
    (turned,) = (series for series in found.found.series if series.of.die == "TURNED")
    assert turned.values.tolist() == [pytest.approx(count / 49) for count in (15, 14)] * 2


@pytest.mark.parametrize(
    ("code", "words", "edits"),
    [
        ("MF105", "process.cd_bias", (("process.cd_bias", "process.bias"),)),
        ("MF105", "is a table", (("process.cd_bias", "process"),)),
        ("MF105", "no die 'PLANE'", (("process.cd_bias", "die.PLANE.seed"),)),
        ("MF105", "no die 'PLANE'", (('"PLAIN"', '"PLANE"'),)),
        ("MF103", "'-0.5' ", (('"-0.5 um"', '"-0.5"'),)),
        ("MF103", "no unit", (('from = "0 um"', 'from = "0"'),)),
        ("MF103", "'0 um' has the unit 'um' and", (('to = "1 um"', 'to = "1 mm"'),)),
        ("MF105", "at least 1 item", (('"-0.5 um", "0 um", "0.5 um"', ""),)),
        ("MF160", "states no values", (('values = ["-0.5 um", "0 um", "0.5 um"]', ""),)),
        ("MF160", f"limit of {MOST_CASES}", (("count = 2", "count = 100000"),)),
        ("MF160", "sweep.cases", (('values = ["-0.5 um", "0 um", "0.5 um"]', 'uniform = ["0 um", "1 um"]'),)),
        ("MF161", "psf_difference", (('"open_ratio"', '"written_psf_diference"'),)),
        ("MF162", "'0 um' and '0 nm'", (('"0 um", "0.5 um"', '"0 um", "0 nm"'),)),
        ("MF109", "varied twice", (("process.corner_radius", "process.cd_bias"),)),
        ("MF102", "unknown key 'sweep.job_file'", (("job =", "job_file ="),)),
    ],
)
def test_what_a_study_may_not_ask(code, words, edits, tmp_path):
    with pytest.raises(JobError, match=code) as refused:
        planned(write_study(tmp_path, *edits))
    assert words in f"{refused.value}"


def test_places_and_engines_that_cannot_be_used(tmp_path):
    study = write_study(tmp_path)
    with pytest.raises(OutputError, match="MF402"):
        mf.sweep(study, tmp_path)
    with pytest.raises(JobError, match="MF105"):
        mf.sweep(study, tmp_path / "out", engine="dask")
    assert not (tmp_path / "out").exists()


def test_a_scheduler_that_does_not_answer_is_refused_before_any_case(tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="dask.distributed is not installed (extra cluster)")
    monkeypatch.setattr("maskfab.base.workers._ANSWERS_WITHIN_S", 0.5)
    with pytest.raises(JobError, match="MF164"):
        made(planned(write_study(tmp_path)), tmp_path / "out", engine="dask", scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


def test_workers_of_another_version_are_refused_before_any_case():
    def cluster(versions: dict[str, object]) -> SimpleNamespace:
        return SimpleNamespace(run=lambda function, on_error: versions)

    check_version(cluster({"tcp://a": of_installation()}), "tcp://s", of_installation)
    for versions, words in (
        ({}, "no workers"),
        ({"tcp://a": of_installation(), "tcp://b": "another"}, "tcp://b runs another maskfab"),
        ({"tcp://a": ModuleNotFoundError("maskfab")}, "ModuleNotFoundError"),
    ):
        with pytest.raises(JobError, match="MF164") as refused:
            check_version(cluster(versions), "tcp://s", of_installation)
        assert words in str(refused.value)


def test_without_dask_a_cluster_is_refused_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(MissingPackageError, match=r"MF152.*\[cluster\]"):
        mf.sweep(write_study(tmp_path), tmp_path / "out", engine="dask", scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()
