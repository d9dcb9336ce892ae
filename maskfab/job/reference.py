"""Keys of a job: their form, default and meaning, the JSON Schema, and which verb depends on which of them.

Form and default are those of the types that check a job; the meaning is the text that stands below each key in
:mod:`maskfab.job.sections` and its neighbours. The schema is that of the same types, with values as a job
file writes them: an editor may let pass what :func:`maskfab.job.read.read` refuses, and refuses nothing that it takes.

A verb declares what it uses; whatever else a job states is named in the verb's answer, or refused. So a key that is new
in the schema is named by every verb until one says that it uses it. A table stands for all its keys; where a verb uses
some of a table, or where keys are still to come, keys are listed one by one. Names and titles ask for nothing, and
every verb goes by them.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Set
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import TypeAdapter

from maskfab.base.errors import JobError
from maskfab.job import camera, die, order, process, sections
from maskfab.job.sections import AssumedPlate, JobSpec
from maskfab.job.values import AnySection, Section, Stated, key_of, sections_of, values_of

Keys = tuple[str, ...]

INNER = frozenset({"openings", "maps", "curves", "shops"})
"""Tables that a resolved job holds and nobody writes."""


_NAMES: Keys = ("job", "die.name", "die.label")
_STATED = json.loads(Path(__file__).with_name("uses.json").read_text(encoding="utf-8"))


def _keys(listed: str) -> Iterator[str]:
    """Keys and tables of a list, in which ``$`` stands before the name of a group of them."""
    for word in listed.split():
        yield from _keys(_STATED["groups"][word[1:]]) if word[0] == "$" else (word,)


USES: Mapping[str, Keys] = MappingProxyType({verb: tuple(_keys(listed)) for verb, listed in _STATED["uses"].items()})
"""By verb; and what it uses more where it is asked in one way, or instead."""


def unused(spec: JobSpec, *uses: str) -> tuple[str, ...]:
    """Names of all that a job states and a verb does not depend on, in the order of the job; see :func:`named`."""
    return tuple(dict.fromkeys(_unused(spec, "", frozenset((*_NAMES, *uses)))))


def covered(path: str, uses: Collection[str]) -> bool:
    """Whether a key, such as ``process.spread.bias``, is one of the keys, or of the tables, that are used."""
    parts = path.split(".")
    return not {".".join(parts[:end]) for end in range(1, len(parts) + 1)}.isdisjoint((*_NAMES, *uses))


def named(path: str, *, table: bool = False) -> str:
    """A key as messages name it: ``gap of [scene]``, ``[process.spread]``, ``gutter of [[die]]``."""
    if table:
        return f"[[{path}]]" if path == "die" else f"[{path}]"
    section, _, key = path.rpartition(".")
    return f"{key} of {named(section, table=True)}" if section else f"[{key}]"


def in_words(names: tuple[str, ...]) -> tuple[str, ...]:
    """The sentence that names what a verb does not use; none without names."""
    return (f"Not used of the job: {', '.join(names)}.",) if names else ()


def _unused(section: AnySection, path: str, used: frozenset[str]) -> Iterator[str]:
    for key, field, value in values_of(section):
        here = f"{path}.{key}".lstrip(".")
        if here in used or here in INNER or value is None or isinstance(value, AssumedPlate):
            continue
        tables = [table for table in (value if isinstance(value, tuple) else (value,)) if isinstance(table, AnySection)]
        if not field.is_required() and value == field.default:
            continue
        if not tables:
            yield named(here)
        elif not any(key.startswith(f"{here}.") for key in used - frozenset(_NAMES)):
            yield named(here, table=True)
        else:
            for table in tables:
                yield from _unused(table, here, used)


_FORMS = json.loads(Path(__file__).with_name("forms.json").read_text(encoding="utf-8"))
FORMS: Mapping[str, str] = {**_FORMS["texts"], **_FORMS["others"]}
"""Forms of values by the names of their types, where those say more than the plain type does."""
_PLAIN: Mapping[str, str] = MappingProxyType(
    {"integer": "whole number", "number": "number", "string": "text", "boolean": "true or false", "object": "table"}
)
_LIMITS: Mapping[str, str] = MappingProxyType(
    {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
)

_LIKE, _PART_OF_A_WORD = 0.7, 0.9
"""Likeness of words, 1 of equal ones: from which on one may be meant, and of one that is part of the other."""


@dataclass(frozen=True)
class Key:
    """One key of a job file and its section; its default as a job writes it, None if required, empty if unset."""

    section: str
    name: str
    form: str
    default: str | None
    meaning: str

    @property
    def path(self) -> str:
        """Table and key, without the method that the key is for."""
        return f"{self.section.partition(' ')[0]}.{self.name}".lstrip(".")


@dataclass(frozen=True)
class Table:
    """One table of a job file: its name, its text, and its keys."""

    name: str
    meaning: str
    keys: tuple[Key, ...]


@cache
def tables() -> tuple[Table, ...]:
    """Every table of a job file, in the order in which a job states them."""
    return tuple(_tables(JobSpec, ""))


def keys_of(path: str, *, or_word: bool = False) -> tuple[Key, ...]:
    """The keys of a path such as ``camera.stop.diameter``, or of a table such as ``camera`` or ``[camera]``.

    Args:
        or_word: take a word such as ``diameter``, too: every key that it ends, and those of every table that it ends.

    Raises:
        JobError: MF105 for an unknown path, with those that look like it.
    """
    every = [key for table in tables() for key in table.keys]
    wanted = path.strip().strip("[]").lower()
    keys = tuple(key for key in every if wanted in {key.path, key.path.rpartition(".")[0]})
    if or_word and not keys:
        keys = tuple(key for key in every if wanted in {key.name, key.path.rpartition(".")[0].rpartition(".")[2]})
    if not (wanted and keys):
        meant = _alike(wanted, {place for key in every for place in (key.path, key.path.rpartition(".")[0])} - {""})
        listed = "maskfab explain lists all codes; a key is written as camera.pixel, a table as camera"
        cure = f"Did you mean {' or '.join(meant)}? {listed}" if meant else listed
        raise JobError("MF105", f"a job has no key or table {path!r}", where="KEY", cure=cure)
    return keys


def _alike(wanted: str, paths: Set[str]) -> list[str]:
    """The likeliest paths, three at most: by their last word, and of those that are alike in it by what precedes it."""
    table, _, word = wanted.rpartition(".")

    def likeness(path: str) -> tuple[float, float]:
        before, _, last = path.rpartition(".")
        held = _PART_OF_A_WORD if word in last.split("_") else SequenceMatcher(None, word, last).ratio()
        return 1.0 if word == last else held, SequenceMatcher(None, table, before).ratio()

    likely = {path: likeness(path) for path in paths if wanted}
    near = sorted(path for path, (last, _) in likely.items() if last >= _LIKE)
    return sorted(near, key=lambda path: sum(likely[path]), reverse=True)[:3]


def _tables(model: type[AnySection], name: str) -> Iterator[Table]:
    inner = {key: list(sections_of(field)) for key, field in model.model_fields.items()}
    own = tuple(_key(model, name, key) for key in model.model_fields if not inner[key])
    if own:
        yield Table(name, inspect.cleandoc(model.__doc__ or ""), own)
    for key, models in inner.items():
        path = f"{name}.{key}".lstrip(".")
        if len(models) == 1:
            yield from _tables(models[0], path)
        elif models:
            yield from _methods(models, path)


def _methods(models: list[type[AnySection]], path: str) -> Iterator[Table]:
    """A table whose keys depend on its method: those in common, then those of each."""
    common = next(base for base in models[0].__mro__[1:] if issubclass(base, AnySection))
    yield from _tables(common, path)
    for model in models:
        method = f'{path} (method = "{model.__name__.removesuffix("Section").lower()}")'
        own = [key for key in model.model_fields if key not in common.model_fields]
        yield Table(method, inspect.cleandoc(model.__doc__ or ""), tuple(_key(model, method, key) for key in own))


def _key(model: type[AnySection], section: str, name: str) -> Key:
    written, meaning = written_key(model, name)
    return Key(section, name, _form(model, name, written), _default(model, name), meaning)


def holds_sections(model: type[AnySection], name: str) -> bool:
    """Whether a section's key is a table with keys of its own, or a list of such tables."""
    return any(sections_of(model.model_fields[name]))


def written_key(model: type[AnySection], name: str) -> tuple[str, str]:
    """Annotation and meaning of a section's key, as its source states them."""
    return next(_source()[base.__name__, name] for base in model.__mro__ if (base.__name__, name) in _source())


@cache
def _source() -> Mapping[tuple[str, str], tuple[str, str]]:
    """Annotation and text of every key, by class and name, from the source of the sections."""
    found: dict[tuple[str, str], tuple[str, str]] = {}
    for module in (sections, die, camera, process, order):
        for section in ast.parse(inspect.getsource(module)).body:
            if not isinstance(section, ast.ClassDef):
                continue
            key_in_job = key_of if issubclass(getattr(module, section.name), Stated) else str
            for key, text in zip(section.body, section.body[1:], strict=False):
                match key, text:
                    case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(meaning))):
                        written = ast.unparse(key.annotation), " ".join(meaning.split())
                        found[section.name, key_in_job(name)] = written
    return MappingProxyType(found)


_schema: Callable[[Any], Mapping[str, Any]] = cache(lambda model: model.model_json_schema())
"""Made once of a section, not once of every key."""


def _form(model: type[AnySection], name: str, written: str) -> str:
    for word in re.findall(r"\w+", written):
        if word in FORMS:
            return FORMS[word]
    stated = _schema(model)
    schema = stated["properties"][name]
    choices = [choice for choice in schema.get("anyOf", [schema]) if choice.get("type") != "null"]
    schema = choices[0]
    if "$ref" in schema:
        schema = stated["$defs"][schema["$ref"].rpartition("/")[2]]
    if "items" in schema or "prefixItems" in schema:
        inner = schema.get("items") or schema["prefixItems"][0]
        return f"list of {_words(inner)}"
    return _words(schema)


def _words(schema: Mapping[str, Any]) -> str:
    if "oneOf" in schema:
        return ", or ".join(_words(choice) for choice in schema["oneOf"])
    if "const" in schema:
        return json.dumps(schema["const"])
    if "enum" in schema:
        return ", ".join(json.dumps(choice) for choice in schema["enum"])
    limits = [f"{sign} {schema[key]:,.15g}".replace(",", " ") for key, sign in _LIMITS.items() if key in schema]
    return ", ".join([_PLAIN[schema["type"]], *limits])


def _default(model: type[AnySection], name: str) -> str | None:
    if model.model_fields[name].is_required():
        return None
    field = model.model_fields[name]
    value = TypeAdapter(field.rebuild_annotation()).dump_python(
        field.get_default(call_default_factory=True), mode="json"
    )
    return "" if value is None or value == {} else json.dumps(value)


def job_schema() -> dict[str, Any]:
    """The JSON Schema (draft 2020-12)."""
    stated = JobSpec.model_json_schema()
    kinds = {kind.__name__: kind for root in (Section, Stated) for kind in _sections(root)}
    for name, rules in {JobSpec.__name__: stated, **stated["$defs"]}.items():
        if name in kinds:
            written = {key: rule for key, rule in rules["properties"].items() if key not in INNER}
            rules["properties"] = {key: _as_written(kinds[name], key, rule) for key, rule in written.items()}
            rules.pop("title", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "maskfab job", **stated}


def _sections(kind: type[AnySection]) -> list[type[AnySection]]:
    return [kind for below in kind.__subclasses__() for kind in (below, *_sections(below))]


def _as_written(kind: type[AnySection], key: str, rules: dict[str, Any]) -> dict[str, Any]:
    """Rules of one key: of a value with a unit or of several forms, those of its text in the job."""
    if holds_sections(kind, key):
        return rules
    annotation, meaning = written_key(kind, key)
    form = next((word for word in re.findall(r"\w+", annotation) if word in FORMS), None)
    stated = {"description": meaning if form is None else f"{meaning} Form: {FORMS[form]}."}
    if form is None:
        return {name: rule for name, rule in rules.items() if name != "title"} | stated
    return stated | ({"type": "string"} if form in _FORMS["texts"] else {})
