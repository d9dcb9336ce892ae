"""Every fault of a job at once: those that pydantic finds, in our words, and the rest of the job to be judged further.

What is at fault takes with it only what depends on it. A table that has a bad value is made without that value, and a
check that reads it ends in silence (:class:`maskfab.base.errors.AtFault`); all others are made as ever.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import fields
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar, cast

from pydantic import TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from maskfab.base import __version__, resources
from maskfab.base.errors import AtFault, Faults, InputError, JobError, MaskfabError
from maskfab.base.units import parse_length_um, parse_pitch_um
from maskfab.job.camera import stop_ratio
from maskfab.job.values import PART, AnySection, Section, key_of, sections_of

if TYPE_CHECKING:
    from maskfab.job.die import DieSection
    from maskfab.job.sections import JobSpec

Place: TypeAlias = tuple[int | str, ...]

_UNKNOWN = frozenset({"extra_forbidden", "unexpected_keyword_argument"})
_OUT_OF_RANGE = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number"})
_MISSING = frozenset({"missing", "missing_argument"})

_MEANT = json.loads(Path(__file__).with_name("meant.json").read_text(encoding="utf-8"))
_TYPES: Mapping[str, str] = _MEANT["types"]
"""Faults of the type of a value, by pydantic's names of them, in words of a job file."""
_KEYS: Mapping[str, list[str]] = _MEANT["keys"]
"""Keys, and what others call them; a key is meant only in a table that has it."""


def problems(error: ValidationError, kind: type[AnySection], values: object, where: str) -> list[JobError]:
    """All that pydantic found, as errors of ours that name the key, less what follows from another of them."""
    found = [(_written(one["loc"]), one) for one in error.errors(include_url=False)]
    # An unknown key comes before the rest: a misspelt one is also missing under its true name.
    found.sort(key=lambda pair: pair[1]["type"] not in _UNKNOWN)
    places = [place for place, _ in found]
    stands_for = {_meant(kind, values, place) for place, one in found if one["type"] in _UNKNOWN}
    told = []
    for place, one in found:
        # A list of which one item is wrong may also count as too short.
        of_items = any(other != place and other[: len(place)] == place for other in places)
        if of_items or (one["type"] in _MISSING and place in stands_for) or _follows(place, one, places):
            continue
        told.append(_refusal(place, one, kind, values, where))
    return told


def sound_part(error: ValidationError, kind: type[AnySection], values: object, faults: Faults, where: str) -> Any:
    """The table without the values at which pydantic found a fault, for checks that need none of them.

    Checks within a table whose values are not all sound are made here as far as they read sound ones.

    Args:
        faults: gets what those checks refuse.

    Raises:
        AtFault: where nothing of it is sound.
    """
    found = [(_written(one["loc"]), one["type"] in _UNKNOWN) for one in error.errors(include_url=False)]
    meant = (_meant(kind, values, place) for place, unknown in found if unknown)
    lost = [*(place for place, _ in found), *(place for place in meant if place is not None)]
    return _made(kind, values, lost, faults, f"{where}: ")


def _made(kind: type[AnySection], values: object, lost: list[Place], faults: Faults, where: str) -> Any:
    if () in lost or not isinstance(values, Mapping):
        raise AtFault
    relative = stop_ratio(values.get("stop"))
    values = values if issubclass(kind, Section) else kind.with_lengths(values)
    held: dict[str, Any] = {}
    gone: set[str] = set()
    for key, field in kind.model_fields.items():
        inner = [place[1:] for place in lost if place[0] == key]
        tables = list(sections_of(field))
        if not inner:
            stated = key in values
            held[key] = (
                _reader(kind, key).validate_python(values[key])  # type: ignore[arg-type]  # classes have a hash
                if stated
                else field.get_default(call_default_factory=True)
            )
        elif () in inner or not tables or hasattr(field.annotation, "stated_as"):
            gone.add(key)
        else:
            table = _of_method(tables, values[key])
            with faults:
                gone.add(key)
                held[key] = _inner(table, values[key], inner, faults, f"{where}{key}")
                gone.discard(key)
    if "focal" in gone and relative:
        gone.add("stop")
    made = _lacking(kind, held, frozenset(gone))
    with faults:
        _check_itself(made, where)
    return made


@cache
def _reader(kind: type[Any], key: str) -> TypeAdapter[Any]:
    """Reader of one value of a table; to make it takes a hundred times as long as to read by it."""
    return TypeAdapter(kind.model_fields[key].rebuild_annotation())


def _inner(kind: type[AnySection], values: Any, lost: list[Place], faults: Faults, where: str) -> Any:
    if isinstance(values, Mapping):
        return _made(kind, values, lost, faults, f"{where}.")
    if not isinstance(values, list) or any(isinstance(place[0], str) for place in lost):
        raise AtFault
    return tuple(
        _made(kind, item, [place[1:] for place in lost if place[0] == i], faults, f"{where}[{i}].")
        if any(place[0] == i for place in lost)
        else TypeAdapter(kind).validate_python(item)
        for i, item in enumerate(values)
    )


def _lacking(kind: type[AnySection], held: Mapping[str, Any], gone: frozenset[str]) -> Any:
    """A table without checks, whose keys that are at fault cannot be read."""
    made: Any
    if issubclass(kind, Section):
        made, names = kind.model_construct(**held), gone
    else:
        made = object.__new__(kind)
        named = {key_of(field.name): field.name for field in fields(cast(Any, kind))}
        vars(made).update({named[key]: value for key, value in held.items()})
        names = frozenset(named[key] for key in gone)

    def read(self: Any, name: str) -> Any:
        if name in names:
            raise AtFault
        return super(partial, self).__getattribute__(name)

    partial = cast(Any, type(kind))(kind.__name__, (kind,), {"__getattribute__": read, "__module__": kind.__module__})
    object.__setattr__(made, "__class__", partial)
    return made


def _check_itself(made: Any, where: str) -> None:
    """Checks of a table on its own values, which pydantic leaves out where one of them is at fault."""
    place = where.rstrip(".: ")
    try:
        if isinstance(made, Section):
            for check in type(made).__pydantic_decorators__.model_validators.values():
                if check.info.mode == "after":
                    cast(Any, check.func)(made)
        elif hasattr(made, "__post_init__"):
            made.__post_init__()
    except PydanticCustomError as error:
        what, _, cure = error.message().partition(PART)
        raise JobError(error.type, what, where=place, cure=cure) from error
    except JobError as error:
        raise JobError(error.code, error.what, where=place, cure=error.cure) from error


def _written(loc: Place) -> Place:
    """A place without what pydantic puts into it: the method that [design] was read as, or a word or number."""
    loc = loc[:-1] if loc[-1:] in {("word",), ("number",)} else loc
    return loc[:1] + loc[2:] if loc[:1] == ("design",) and loc[1:2] in {("search",), ("relax",)} else loc


def _follows(place: Place, one: ErrorDetails, places: Sequence[Place]) -> bool:
    """Whether a stop is stated by a focal length that is at fault itself."""
    return place[-1:] == ("stop",) and stop_ratio(one["input"]) and (*place[:-1], "focal") in places


def _refusal(place: Place, one: ErrorDetails, kind: type[AnySection], values: object, where: str) -> JobError:
    key, code = _text(place) or "the file", one["type"]
    at, last = f"{where}: {key}", str(place[-1]) if place else ""
    if code.startswith("MF"):
        what, _, cure = one["msg"].partition(PART)
        if code == "MF103" and isinstance(one["input"], int | float) and (unit := _unit(place)):
            cure = f'Write {last} = "{one["input"]:g} {unit}", if that is its unit'
        return JobError(code, what if code == "MF110" or not place else f"{key} = {what}", where=at, cure=cure)
    if code in _UNKNOWN:
        return JobError("MF102", f"unknown key {key!r}", where=at, cure=_unknown(kind, values, place))
    if code in _MISSING:
        return JobError("MF105", f"the key {key!r} is missing", where=at, cure=_addition(place))
    number = "MF104" if code in _OUT_OF_RANGE else "MF105"
    what = f"{key} = {one['input']!r}: {_meant_of(one)}"
    if isinstance(one["input"], dict) and code == "tuple_type":
        return JobError(number, what, where=at, cure=f"Write [[{key}]] for each of them")
    if (dots := _in_dots(last, one["input"], values, place)) is not None:
        return JobError(number, what, where=at, cure=dots)
    example = _example(place)
    such = "" if example is None or number == "MF104" else f", such as {last} = {_toml(example)}"
    return JobError(number, what, where=at, cure=f"Change {key}{such}")


def _meant_of(one: ErrorDetails) -> str:
    limits = one.get("ctx", {})
    if one["type"] in ("too_short", "too_long"):
        limit = limits.get("min_length", limits.get("max_length"))
        how = "at least" if "min_length" in limits else "at most"
        return f"{how} {limit} item{'' if limit == 1 else 's'} must be there, not {limits['actual_length']}"
    return _TYPES.get(one["type"], f"{one['msg'][0].lower()}{one['msg'][1:]}")


def _addition(place: Place) -> str:
    example = _example(place)
    if isinstance(example, dict | list) and example and isinstance(next(iter(example)), dict):
        return f"Add [[{place[-1]}]]"
    if isinstance(example, dict) and len(place) == 1:
        return f"Add [{place[0]}] with {', '.join(f'{key} = {_toml(value)}' for key, value in example.items())}"
    return f"Add {place[-1]}" if example is None else f"Add {place[-1]} = {_toml(example)}, say"


def _unknown(kind: type[AnySection], values: object, place: Place) -> str:
    table, key, value = _table(kind, values, place[:-1]), str(place[-1]), _value(values, place)
    meant = _meant(kind, values, place)
    if meant is not None:
        return _in_dots(str(meant[-1]), value, values, meant) or _renamed(key, meant, value)
    others = [] if table is None or len(place) < 2 else [*_elsewhere(kind, key, str(place[0]))]
    if others:
        return f"Move it to {' or '.join(others)}, or remove it"
    listed = "" if table is None else f"; {_text(place[:-1]) or 'a job'} has {', '.join(table.model_fields)}"
    return f"Remove it, or mend its spelling{listed}; this is maskfab {__version__}, and a later one may know it"


def _renamed(key: str, meant: Place, value: object) -> str:
    name, number = meant[-1], isinstance(value, int | float)
    if name == "stop" and number:
        return f'Write stop = "f/{value:g}"' if cast(float, value) < 100 else 'Write stop = "f/1.8", or its diameter'
    if name == "clear_dots" and isinstance(value, float):
        return "Write clear_dots, a number of dots: the open ratio times dots x dots"
    if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
        return f"Call it {name}"
    if number and (unit := "dpi" if key in ("dpi", "ppi") else _unit(meant)):
        value = f"{value:g} {unit}"
    elif name == "wavelengths" and not isinstance(value, list):
        value = [value]
    return f"Write {name} = {_toml(value)}"


def _in_dots(key: str, value: object, values: object, place: Place) -> str | None:
    """The line to write where a length stands for a number of dots, in dots of the table about it; None elsewhere."""
    if not key.endswith("dots") or not isinstance(value, str):
        return None
    try:
        length_um = parse_length_um(value)
    except InputError:
        return None
    for depth in range(len(place) - 1, -1, -1):
        with suppress(InputError, KeyError, TypeError, ZeroDivisionError):
            held = cast(Mapping[str, Any], _value(values, place[:depth]))
            gutter_um = parse_length_um(held.get("gutter", "0 um"), zero_allowed=True)
            side_um = parse_pitch_um(held["pitch"]) - gutter_um if "dot" not in held else 0.0
            dot_um = side_um / held["dots"] if side_um else parse_length_um(held["dot"])
            count, of = length_um / dot_um, f"of {dot_um:g} um"
            if (near := round(count)) and abs(count - near) < _WHOLE:
                return f"Write {key} = {near}: it counts dots, here {of}"
            low = math.floor(count)
            either = f"{low} or {low + 1}" if low else "1"
            return f"Write {key} = {either}: it counts dots, and {value} are {count:.3g} {of}"
    return f"Write {key} as a whole number: it counts dots, and is no length"


_WHOLE = 1e-6
"""Of a number of dots, how far it may lie from a whole one by rounding."""


def _unit(place: Place) -> str:
    """The unit in which a length of that key is usually written; empty for what has none."""
    example = _example(place)
    return example.lstrip("0123456789.e+- ") if isinstance(example, str) and example[:1].isdigit() else ""


def _meant(kind: type[AnySection], values: object, place: Place) -> Place | None:
    """The place that an unknown key is likely meant for, if its table has such a key and does not state it."""
    table, key = _table(kind, values, place[:-1]), str(place[-1]).lower().replace("-", "_")
    if table is None:
        return None
    held = _value(values, place[:-1])
    free = [name for name in table.model_fields if not (isinstance(held, Mapping) and name in held)]
    named = [name for name in free if key in _KEYS.get(name, ())]
    near = get_close_matches(key, free, n=1, cutoff=0.75)
    chosen = (near if near and near[0].replace("_", "") == key.replace("_", "") else named) or near
    return (*place[:-1], chosen[0]) if chosen else None


def _table(kind: type[AnySection], values: object, place: Place) -> type[AnySection] | None:
    table: type[AnySection] | None = kind
    for i, part in enumerate(place):
        if isinstance(part, int):
            continue
        field = None if table is None else table.model_fields.get(part)
        kinds = [] if field is None else list(sections_of(field))
        table = _of_method(kinds, _value(values, place[: i + 1])) if kinds else None
    return table


def _of_method(kinds: Sequence[type[AnySection]], values: object) -> type[AnySection]:
    """The table of a method of [design], where that is one of several."""
    relaxed = isinstance(values, Mapping) and values.get("method") == "relax"
    return kinds[-1 if relaxed else 0]


def _elsewhere(kind: type[AnySection], key: str, here: str) -> Iterator[str]:
    for name, field in kind.model_fields.items():
        if name != here and any(key in table.model_fields for table in sections_of(field)):
            yield f"[[{name}]]" if name == "die" else f"[{name}]"


def _value(values: Any, place: Place) -> Any:
    for part in place:
        try:
            values = values[part]
        except (KeyError, IndexError, TypeError):
            return None
    return values


def _text(place: Place) -> str:
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


@cache
def _examples() -> Mapping[str, Any]:
    read: dict[str, Any] = {}
    for name in ("display_that_fits", "first_plate"):
        read |= tomllib.loads(resources.path(f"layouts/{name}.toml").read_text(encoding="utf-8"))
    return read


def _example(place: Place) -> Any:
    return _value(_examples(), tuple(0 if isinstance(part, int) else part for part in place))


def _toml(value: object) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_toml(inner)}" for key, inner in value.items()) + " }"
    if isinstance(value, list):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value, ensure_ascii=False, default=str)


_DIE = re.compile(r"\bdie\[(\d+)\]")


class JobFaults(Faults):
    """Faults of a job, each of which names its die; ``dies`` in the order of the job, None for one that has none."""

    def __init__(self, dies: Sequence[str | None] = ()) -> None:
        super().__init__()
        self._dies = dies

    @classmethod
    def of(cls, document: object) -> JobFaults:
        """None yet, of a job as plain data, whatever it holds."""
        dies = document.get("die") if isinstance(document, Mapping) else None
        return cls(tuple(_names(dies)) if isinstance(dies, list | tuple) else ())

    @classmethod
    def of_spec(cls, spec: JobSpec) -> JobFaults:
        """None yet, of a job of which some may be at fault."""
        dies: Sequence[DieSection] = ()
        with (faults := cls()):
            dies = spec.die
        names: list[str | None] = [None] * len(dies)
        for number, die in enumerate(dies):
            with faults:
                names[number] = die.name
        return cls(names)

    def add(self, fault: MaskfabError) -> None:
        """Keep a fault, with the name of its die."""
        for one in fault.faults:
            number = _DIE.search(one.where)
            known = number is not None and int(number[1]) < len(self._dies)
            super().add(_of_die(one, self._dies[int(number[1])] if number is not None and known else None))

    @contextmanager
    def of_die(self, name: str) -> Iterator[None]:
        """Refusals of what a die names, which need not know which die that is."""
        try:
            yield
        except InputError as error:
            raise _of_die(error, name) from error


def _of_die(fault: MaskfabError, name: str | None) -> MaskfabError:
    if name is None or repr(name) in fault.what:
        return fault
    return type(fault)(fault.code, f"die {name!r}: {fault.what}", where=fault.where, cure=fault.cure)


def _names(dies: Sequence[object]) -> Iterator[str | None]:
    for die in dies:
        name = die.get("name") if isinstance(die, Mapping) else None
        yield name if isinstance(name, str) and len(name) <= 24 else None


Kind = TypeVar("Kind", bound=AnySection)


def parse_section(kind: type[Kind], values: object, *, where: str) -> Kind:
    """One section from values that did not come from a file; errors as for a job."""
    try:
        return cast(Kind, kind.model_validate(values))
    except ValidationError as error:
        faults = Faults()
        for fault in problems(error, cast(type[AnySection], kind), values, where):
            faults.add(fault)
        faults.refuse()
        raise
