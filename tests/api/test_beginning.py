"""A job to begin with, and the schema from which editors complete one."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft202012Validator
from small_job import command, listing

import maskfab as mf
from maskfab.api.beginning import templates

LAYOUTS = Path(mf.__file__).parents[1] / "layouts"


@pytest.fixture(scope="module")
def rules() -> Draft202012Validator:
    Draft202012Validator.check_schema(mf.explain(schema="job").to_dict())
    return Draft202012Validator(mf.explain(schema="job").to_dict())


@pytest.mark.parametrize("name", templates())
def test_a_job_to_begin_with_has_all_that_it_names(tmp_path, name):
    begun = mf.new(tmp_path / "mine", name)
    assert mf.load_job(begun.job).digest == mf.load_job(LAYOUTS / f"{name}.toml").digest
    assert {path.relative_to(tmp_path / "mine").as_posix() for path in begun.files} == {
        name for name, content in listing(tmp_path / "mine").items() if content is not None
    }


def test_a_folder_in_use_is_left_alone_and_an_unknown_job_refused(capsys, tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    told = command(capsys, "new", tmp_path)
    assert (told.code, "MF402" in told.stderr) == (2, True)
    told = command(capsys, "new", tmp_path / "fresh", "--from", "upc13")
    assert (told.code, "--from" in told.stderr, "upc12" in told.stderr) == (2, True, True)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_the_schema_takes_every_shipped_job(rules):
    for path in sorted([*LAYOUTS.glob("*.toml"), *LAYOUTS.glob("studies/*.toml")]):
        stated = tomllib.loads(path.read_text(encoding="utf-8"))
        rules.validate(json.loads(json.dumps(stated, default=str)))  # JSON has no dates


@pytest.mark.parametrize(
    "wrong",
    [
        {"job": {"name": "A", "titel": "B"}},
        {"job": {"name": "A"}, "camera": {"focal": 10}},
        {"job": {"name": "A"}, "die": {"name": "B"}},
        {"jobs": {}},
    ],
)
def test_the_schema_refuses_what_no_job_may_hold(rules, wrong):
    assert not rules.is_valid(wrong)


def test_the_command_prints_it(capsys):
    for of in ("job", "report", "check"):
        Draft202012Validator.check_schema(json.loads(command(capsys, "explain", "--schema", of).stdout))
    told = command(capsys, "explain", "--schema", "plate")
    assert (told.code, "MF105" in told.stderr) == (2, True)
    described = mf.explain(schema="job").to_dict()["$defs"]["StopSection"]["properties"]["diameter"]["description"]
    assert described.startswith(mf.explain("camera.stop.diameter").to_dict()["keys"][0]["meaning"])
