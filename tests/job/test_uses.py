"""Uses: every key of the schema is declared by a verb or named in its answer, and declarations hold."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pydantic_core import PydanticUndefined
from small_job import OPENING, command, write_job

from maskfab.api.checking import check
from maskfab.api.measuring import edge
from maskfab.base.errors import InputError
from maskfab.base.findings import STAGE_OF_QUANTITY
from maskfab.cli.command import command_of
from maskfab.cli.program import VERBS
from maskfab.job.reference import INNER, USES, covered, in_words, named, unused
from maskfab.job.sections import JobSpec
from maskfab.job.values import AnySection, Section, key_of, sections_of


def stating(kind: type[AnySection], path: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every key below a table, and what states that key alone: a value that no default equals, unchecked."""
    for key, field in kind.model_fields.items():
        here, several = f"{path}.{key}".lstrip("."), "tuple" in str(field.annotation)
        inner = list(dict.fromkeys(sections_of(field)))
        if here in INNER:
            continue
        if not inner:
            yield here, {key: object()}
        for each in inner:
            for below, value in stating(each, here):
                section = bare(each, value)
                yield below, {key: (section,) if several else section}


def bare(kind: type[AnySection], stated: dict[str, Any]) -> AnySection:
    """A section that states some keys and no others, required ones neither."""
    rest = {key: None for key, field in kind.model_fields.items() if field.default is PydanticUndefined}
    if issubclass(kind, Section):
        return kind.model_construct(**(rest | stated))
    made = object.__new__(kind)
    for name in (field.name for field in dataclasses.fields(kind)):
        key = key_of(name)
        object.__setattr__(made, name, {key: kind.model_fields[key].default, **rest, **stated}[key])
    return made


KEYS = list(stating(JobSpec))


def test_every_key_of_the_schema_is_used_by_a_verb_or_named_in_its_answer():
    """Keys are those of the types that check a job: one that is new tomorrow is named until a verb declares it."""
    assert len(dict(KEYS)) > 200
    silent = []
    for use in USES:
        for path, stated in KEYS:
            names = unused(bare(JobSpec, stated), *USES[use])
            tables = [".".join(path.split(".")[:end]) for end in range(1, path.count(".") + 1)]
            told = {named(path), *(named(table, table=True) for table in tables)} & set(names)
            used = covered(path, USES[use])
            if not (told or used):
                silent.append((use, path))
            assert not (told and used) or path in {"die.name", "die.label"}, (use, path)
    assert silent == []


def test_a_key_of_tomorrow_is_named_by_every_verb_that_lists_keys_of_its_table():
    class Scene(JobSpec.model_fields["scene"].annotation.__args__[0]):
        haze: float = 0.0

    spec = bare(JobSpec, {"scene": bare(Scene, {"haze": 0.1})})
    assert all(unused(spec, *keys) in {("haze of [scene]",), ("[scene]",)} for keys in USES.values())


def test_declarations_are_keys_of_the_schema():
    known = {".".join(path.split(".")[:end]) for path, _ in KEYS for end in range(1, path.count(".") + 2)}
    assert {key for keys in USES.values() for key in keys} <= known


def test_every_command_that_takes_a_job_declares_what_it_uses():
    # reproduce and verify without a job make what run made, whose report names the rest; bench needs no job.
    taking = set()
    for verb in VERBS:
        if {"job", "compare", "against"} & {each.name for each in command_of(verb).parameters}:
            taking.add(verb)
    study = {"study", "sweep"}
    assert taking | study <= {use.partition(" --")[0] for use in USES}
    assert {f"sweep {finding.name}" for finding in STAGE_OF_QUANTITY.values()} <= set(USES)


def test_tables_and_keys_are_named_as_messages_name_them():
    assert named("scene.gap") == "gap of [scene]"
    assert named("die.gutter") == "gutter of [[die]]"
    assert named("process.spread", table=True) == "[process.spread]"
    assert in_words(()) == ()
    assert in_words(("[scene]",)) == ("Not used of the job: [scene].",)


# --- declared use is use ---------------------------------------------------------------------------------------------

STATED = """
[scene]
accuracy = 0.02
focus = "5 m"
depth = ["2 m", "inf"]
gap = "0.05 mm"
field = "0.1 mm"
aberrations = [[11, 0.02]]
spectrum = "rgb"

[sensor]
bits = 10

[process]
corner_radius = "0.3 um"
spread = { bias = "0.05 um" }
roughness = { sigma = "30 nm", correlation = "200 nm" }

[emitters]
colour_gap = "8 um"
min_width = "8 um"
circuit = "100 um^2"
"""
OTHERS = {
    "camera.focal": '"5.2 mm"', "camera.stop.diameter": '"392 um"', "camera.stop.shape": '"square"',
    "camera.wavelengths": '["620 nm", "530 nm", "470 nm"]', "camera.pixel": '"2.5 um"', "camera.window": '"56 um"',
    "camera.stop.inner": None, "camera.stop.width": None, "camera.stop.height": None, "camera.stop.corners": None,
    "scene.accuracy": "0.2", "scene.depth": '["7 m", "9 m"]', "scene.focus": '"3 m"', "scene.field": '"0.2 mm"',
    "scene.gap": '"0.08 mm"', "scene.aberrations": "[[7, 0.03]]", "scene.saturation": "true",
    "scene.distortion": '{ ratio = 0.02, height = "2 mm" }', "scene.spectrum": '"lines"',
    "scene.illuminant": '"3000 K"',
    "scene.projection": '"f theta"', "scene.tilt": '"2 deg"',
    "sensor.full_well": "5000.0", "sensor.read_noise": "10.0", "sensor.bits": "8", "sensor.black_level": "200",
    "sensor.mosaic": '"rggb"', "sensor.gain": "2.0", "sensor.iso": None, "sensor.base_iso": "100.0",
    "sensor.max_gain": "2.0", "sensor.converter_noise": "9.0", "sensor.banding": "2.0",
    "process.corner_radius": '"1 um"', "process.cd_bias": '"0.4 um"', "process.roughness.sigma": '"60 nm"',
    "process.roughness.correlation": '"400 nm"', "process.spread.bias": '"0.2 um"', "process.spread.radius": '"0.3 um"',
    "process.spread.centre": '"5 um"',
}  # fmt: skip
"""Another value of every key of four tables; None for sizes of stops of other shapes, and an ISO alone."""


def job(folder: Path, key: str = "", value: str | None = None) -> Path:
    """The small job with four tables, one key of them changed."""
    edits = [
        ('wavelengths = ["530 nm"]', 'wavelengths = ["610 nm", "530 nm", "470 nm"]'),
        *[('pitch = "56 um"', 'pitch = "64 um"\ngutter = "8 um"')] * 2,
        ('die_size = "560 um"', 'die_size = "640 um"'),
    ]
    path = write_job(folder, *edits, opening=OPENING)
    document = tomllib.loads(path.read_text(encoding="utf-8") + STATED)
    if value is not None:
        *tables, last = key.split(".")
        table = document
        for each in tables:
            table = table.setdefault(each, {})
        table[last] = tomllib.loads(f"x = {value}")["x"]
    tables = [
        f"[[{name}]]\n{lines(each)}" if isinstance(held, list) else f"[{name}]\n{lines(each)}"
        for name, held in document.items()
        for each in (held if isinstance(held, list) else [held])
    ]
    path.write_text("\n".join(tables), encoding="utf-8")
    return path


def lines(table: dict[str, Any]) -> str:
    return "".join(f"{key} = {inline(value)}\n" for key, value in table.items())


def inline(value: Any) -> str:
    """A value as TOML writes it in one line."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {inline(each)}' for key, each in value.items())} }}"
    return f"[{', '.join(map(inline, value))}]" if isinstance(value, list) else json.dumps(value)


def answer(verb: Callable[[Path], dict[str, Any]], path: Path) -> str:
    """The answer of a verb as text, without hash of the job and names of what it does not use; or its refusal."""
    try:
        found = verb(path)
    except InputError as refusal:
        return f"refused: {refusal}"
    return json.dumps({k: v for k, v in found.items() if k not in {"job_hash", "unused", "notes"}}, sort_keys=True)


def mtf(path: Path) -> dict[str, Any]:
    curve = path.with_name("curve.csv")
    curve.write_text("cycles/pixel,mtf\n0,1\n0.1,0.8\n0.2,0.6\n0.3,0.4\n0.4,0.2\n0.5,0.1\n", encoding="utf-8")
    return edge(curve, path, die="PLAIN").to_dict()


QUICK = {
    "check --optics": (lambda path: check(path, die="PLAIN", optics=True).to_dict(), USES["check --optics"]),
    "check": (lambda path: check(path, die="PLAIN").to_dict(), USES["check"]),
    "check --look": (
        lambda path: check(path, look=True, die="PLAIN", pixels=8, samples=7).to_dict(),
        USES["check --look"],
    ),
    "edge": (mtf, USES["edge"] + USES["measure without --line"]),
}


def test_another_value_is_at_hand_for_every_key_of_camera_scene_sensor_and_process():
    assert set(OTHERS) == {path for path, _ in KEYS if path.split(".")[0] in {"camera", "scene", "sensor", "process"}}


@pytest.mark.slow
@pytest.mark.parametrize("verb", QUICK)
def test_what_a_verb_declares_changes_its_answer_and_what_it_names_does_not(tmp_path: Path, verb: str) -> None:
    made, uses = QUICK[verb]
    usual = answer(made, job(tmp_path))
    assert not usual.startswith("refused")
    for key, value in OTHERS.items():
        if value is not None:
            assert (answer(made, job(tmp_path, key, value)) != usual) == covered(key, uses), key


@pytest.mark.parametrize(
    ("words", "names"),
    [
        (("check",), ("[camera]", "[scene]", "[sensor]", "[process]")),
        (("check", "--optics"), ("[emitters]", "[sensor]", "[process]")),
        (("check", "--look", "--pixels", "8", "--samples", "7", "--out", "OUT"), ("[camera]", "[scene]", "[process]")),
    ],
    ids=lambda each: each[-1] if isinstance(each[0], str) else "",
)
def test_what_is_not_used_stands_in_text_and_json(capsys, tmp_path: Path, words, names) -> None:
    path = job(tmp_path)
    verb, *more = (str(tmp_path / "out") if each == "OUT" else each for each in words)
    text = command(capsys, verb, path, *more, "--die", "PLAIN")
    assert text.code == 0, text.stderr
    more = [f"{each}2" if each.endswith("out") and each != "--out" else each for each in more]
    document = command(capsys, verb, path, *more, "--die", "PLAIN", "--json").document
    assert set(names) <= set(document["unused"])
    assert f"Not used of the job: {', '.join(document['unused'])}." in text.stdout
