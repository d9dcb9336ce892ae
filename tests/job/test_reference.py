"""The reference of a job's keys agrees with the types that check a job."""

from __future__ import annotations

import json

import pytest
from pydantic import ConfigDict, TypeAdapter

from maskfab.base.errors import JobError
from maskfab.job.reference import Key, holds_sections, keys_of, tables
from maskfab.job.sections import AnyDesign, JobSpec
from maskfab.job.values import AnySection, sections_of


@pytest.fixture(scope="module")
def keys() -> list[Key]:
    return [key for table in tables() for key in table.keys]


def fields(model: type[AnySection]) -> set[str]:
    """Names of the keys below a section, as JSON schema sees them."""
    schema = model.model_json_schema()
    sections = {"JobSpec": schema, **schema["$defs"]}
    return {name for each in sections.values() for name in each.get("properties", {})}


def test_every_key_of_the_schema_is_described_and_no_other(keys: list[Key]):
    tables_ = {place for table in tables() for place in table.name.partition(" ")[0].split(".")}
    assert {key.name for key in keys} | tables_ - {""} == fields(JobSpec)


def test_a_default_is_a_value_that_a_job_may_state(keys: list[Key]):
    stated = [key for key in keys if key.default]
    assert len(stated) > 50
    assert [key.path for key in stated if not states_its_default(key)] == []


def states_its_default(key: Key) -> bool:
    """Whether a section that states the default of a key is one that leaves the key out."""
    value = json.loads(key.default or "")
    if key.section.startswith("design (") or key.section == "design":
        method = {"method": "relax"} if "relax" in key.section else {}
        needed: dict[str, object] = {"name": "A", "dots": 3, "pitch": "24 um", "clear_dots": 1}
        if key.name == "clear_dots":
            needed = {**needed, "clear_dots": value, "fit": True}
        spec = TypeAdapter(AnyDesign).validate_python({**needed, **method, key.name: value})
        return spec == TypeAdapter(AnyDesign).validate_python({**needed, **method})
    model: type[AnySection] = JobSpec
    for part in key.section.split("."):
        model = next(sections_of(model.model_fields[part]))
    field = model.model_fields[key.name]
    kind = TypeAdapter(field.rebuild_annotation(), config=None if holds_sections(model, key.name) else STRICT)
    return kind.validate_python(value) == field.get_default(call_default_factory=True)


STRICT = ConfigDict(strict=True)


@pytest.mark.parametrize(
    ("path", "names"),
    [
        ("camera.stop.diameter", {"diameter"}),
        ("[process]", {"corner_radius", "cd_bias"}),
        ("design.anneal", {"anneal"}),
        ("design.protocol", {"protocol"}),
    ],
)
def test_a_path_finds_a_key_or_the_keys_of_a_table(path, names):
    assert {key.name for key in keys_of(path)} == names


@pytest.mark.parametrize(
    ("word", "paths"),
    [
        ("diameter", {"camera.stop.diameter"}),
        ("seed", {"die.seed", "design.seed"}),
        ("stop", {key.path for key in keys_of("camera.stop")}),
    ],
)
def test_a_word_finds_every_key_and_table_that_it_ends(word, paths):
    assert {key.path for key in keys_of(word, or_word=True)} == paths
    with pytest.raises(JobError, match="MF105"):
        keys_of(word)


@pytest.mark.parametrize(
    ("typed", "meant"),
    [
        ("camera.pixl", "camera.pixel"),
        ("gap", "scene.gap"),
        ("", "camera"),
        ("stop", "mean camera.stop "),
        ("camera.stp", "mean camera.stop?"),
        ("dimeter", "mean camera.stop.diameter?"),
        ("emiters", "mean emitters?"),
        ("emiters.gap", "mean emitters."),
        ("emiters.gap", "emitters.gap_to_opening"),
    ],
)
def test_an_unknown_path_is_refused_with_what_was_meant(typed, meant):
    with pytest.raises(JobError, match="MF105") as refused:
        keys_of(typed)
    assert meant in str(refused.value)
