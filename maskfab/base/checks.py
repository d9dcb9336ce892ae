"""Refusals of values that a type or a public function cannot take.

A check of a field reads one field of a frozen dataclass and returns at once where it is sound: the right kind, finite,
in range. Texts are made only for a refusal, for some types are built thousands of times in a search.

Arguments of public functions are held against their annotations before any work: only their type is looked at, and that
a plain number is finite. What a value means is judged where it is used.
"""

from __future__ import annotations

import builtins
import inspect
import math
import re
import sys
import types
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache, partial, wraps
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from maskfab.base.arrays import Labels, Mask
from maskfab.base.errors import JobError, MaskfabError, OpeningError
from maskfab.base.work import notebook_line

_LARGEST = sys.float_info.max
MOST_NM = 2**31 - 1
"""Layouts hold coordinates of 32 bits."""


def whole(owner: object, name: str, least: int, most: int = MOST_NM, *, value: Any = None) -> None:
    """Require a field to be a whole number from ``least`` to ``most``; ``value`` is the part of it that is meant.

    Raises:
        JobError: MF105 for text and the like, MF107 for a part of a nanometre, MF104 out of range.
    """
    value = getattr(owner, name) if value is None else value
    if type(value) is int and least <= value <= most:
        return
    if isinstance(value, float | np.floating) and math.isfinite(value) and value != int(value):
        raise _refusal("MF107", owner, name, f"{value!r} is not a whole number", f"Use {round(value)}")
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise _refusal("MF105", owner, name, f"{value!r} is not a whole number", "Give an integer, without a unit")
    if not least <= value <= most:
        raise _refusal("MF104", owner, name, f"{value} is not {least} to {most}", "Give a number in that range")


def number(
    owner: object, name: str, low: float = 0.0, high: float = _LARGEST, *, open_low: bool = True, value: Any = None
) -> None:
    """Require a field to be a number above ``low``, or from it on unless ``open_low``, and up to ``high``; finite.

    Raises:
        JobError: MF105 for text and the like, MF104 for NaN and out of range.
    """
    value = getattr(owner, name) if value is None else value
    if type(value) is float and low < value <= high:
        return
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.integer | np.floating):
        cure = "Give it as a number in the unit that the name ends in"
        raise _refusal("MF105", owner, name, f"{value!r} is not a number", cure)
    if not (low < value or (value == low and not open_low)) or not value <= high:
        what = f"{value!r} is not {_range(low, high, open_low=open_low)}"
        raise _refusal("MF104", owner, name, what, "Give a number in that range")


def _range(low: float, high: float, *, open_low: bool) -> str:
    from_below = "" if low == -_LARGEST else f"above {low:g}" if open_low else f"{low:g} or more"
    to_above = "finite" if high == _LARGEST else "" if high == math.inf else f"at most {high:g}"
    return " and ".join(limit for limit in (to_above, from_below) if limit)


def choice(owner: object, name: str, allowed: Collection[Any]) -> None:
    """Require a field to be one of some values (MF105)."""
    value = getattr(owner, name)
    if value not in allowed:
        listed = ", ".join(str(option) for option in allowed)
        raise _refusal("MF105", owner, name, f"{value!r} is none of {listed}", "Use one of the values listed")


def instance(owner: object, name: str, kind: type) -> None:
    """Require a field to be of a type (MF105)."""
    value = getattr(owner, name)
    if not isinstance(value, kind):
        raise _refusal("MF105", owner, name, f"{value!r} is no {kind.__name__}", f"Give a {kind.__name__}")


def refuse(code: str, owner: object, name: str, what: str, cure: str) -> None:
    """Refuse a field for a reason that only its type knows."""
    raise _refusal(code, owner, name, what, cure)


def square_mask(owner: object, name: str) -> Mask:
    """A field of clear and opaque dots as bool [n, n].

    Raises:
        OpeningError: MF201 if it is not square or has no dot, MF202 if a dot is neither clear nor opaque.
    """
    mask = np.asarray(getattr(owner, name))
    if mask.ndim != 2 or mask.shape[0] != mask.shape[1] or not mask.size:
        what = f"a mask of shape {mask.shape} is not square"
        raise OpeningError("MF201", what, where=_where(owner, name), cure="Give as many rows as columns, at least one")
    if mask.dtype == np.bool_:
        return mask
    if mask.dtype.kind not in "iuf" or not np.isin(mask, (0, 1)).all():
        what = f"a mask of {mask.dtype} has dots that are neither clear nor opaque"
        raise OpeningError("MF202", what, where=_where(owner, name), cure="Give booleans, or 0 and 1: mask > 0.5")
    return mask.astype(np.bool_)


def labels(owner: object, name: str, count: int, code: str, cure: str) -> Labels:
    """A field of numbers from 0 to ``count`` - 1 as int8 [rows, columns]; a refusal has the code and the cure."""
    values = np.asarray(getattr(owner, name))
    if values.ndim != 2 or not values.size:
        raise _refusal(code, owner, name, f"an array of shape {values.shape} has no rows and columns", cure)
    broken = values.dtype.kind not in "iuf" or (values.dtype.kind == "f" and (values % 1 != 0).any())
    if broken or values.min() < 0 or values.max() >= count:
        raise _refusal(code, owner, name, f"some of its values are not whole numbers from 0 to {count - 1}", cure)
    return values if values.dtype == np.int8 else values.astype(np.int8)


def _refusal(code: str, owner: object, name: str, what: str, cure: str) -> JobError:
    return JobError(code, what, where=_where(owner, name), cure=cure)


def _where(owner: object, name: str) -> str:
    said = getattr(owner, "name", None)
    return f"{type(owner).__name__}{f' {said!r}' if isinstance(said, str) else ''}.{name}"


Given = ParamSpec("Given")
Result = TypeVar("Result")

_WORDS: Mapping[object, str] = types.MappingProxyType(
    {
        str: "text",
        Path: "a path",
        PathLike[str]: "a path",
        bool: "True or False",
        int: "a whole number",
        float: "a number",
        type(None): "None",
    }
)
_MADE = types.MappingProxyType({"Panel": ', such as Panel.tile(opening, size="4.4 mm")'})
"""Ways to make what is asked for, by the name of its type."""
_SHOWN = 60


def checked_arguments(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """For functions that users call: refuses arguments of another type than their annotations say.

    Names that only type checkers import are taken for anything. Where a function tells its progress and nobody asks for
    it, a notebook shows it (:func:`maskfab.base.work.notebook_line`).

    Raises:
        JobError: MF105 for an argument that is missing, unknown or of the wrong type; MF104 for a number that is not
            finite.
    """

    called = function.__qualname__.removesuffix(".__init__")

    @cache
    def expected() -> tuple[inspect.Signature, Mapping[str, Any]]:
        names = inspect.unwrap(function).__globals__
        stated = inspect.signature(checked)
        return stated, {name: _evaluated(parameter.annotation, names) for name, parameter in stated.parameters.items()}

    def found(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        stated, hints = expected()
        try:
            bound = stated.bind(*args, **kwargs)
        except TypeError as error:
            names = ", ".join(name for name in stated.parameters if name not in ("self", "cls"))
            raise JobError("MF105", str(error), where=called, cure=f"The arguments are {names}") from None
        for name, value in bound.arguments.items():
            kind = stated.parameters[name].kind
            if kind is inspect.Parameter.VAR_POSITIONAL:
                values = {f"{name}[{i}]": held for i, held in enumerate(value)}
            elif kind is inspect.Parameter.VAR_KEYWORD:
                values = value
            else:
                values = {name: value}
            for key, held in values.items():
                _require(held, hints[name], f"{called}: {key}")
        untold = "progress" in stated.parameters and "progress" not in bound.arguments
        line = notebook_line(called) if untold else None
        if line is None:
            return function(*args, **kwargs)
        try:
            return function(*args, **{**kwargs, "progress": line})  # type: ignore[arg-type]
        finally:
            line.end()

    @wraps(function)
    def checked(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        if _OPTIONS_KEPT.get():
            return found(*args, **kwargs)
        try:
            with options_kept():
                return found(*args, **kwargs)
        except MaskfabError as error:
            parameters = expected()[0].parameters
            error.reword(lambda text: _OPTION.sub(partial(_argument, parameters), text))
            raise

    if any(str(kind).startswith("Unpack[") for kind in function.__annotations__.values()):
        checked.__signature__ = _spelled_out(function)  # type: ignore[attr-defined]
    return checked


def _spelled_out(function: Callable[..., object]) -> inspect.Signature:
    """Signature with the keys of a typed dictionary as arguments that may be left out."""
    stated, keys = inspect.signature(function), []
    for parameter in stated.parameters.values():
        if parameter.kind is not inspect.Parameter.VAR_KEYWORD:
            keys.append(parameter)
            continue
        (held,) = get_args(_evaluated(parameter.annotation, function.__globals__))
        for name, kind in get_type_hints(held).items():
            keys.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=kind))
    return stated.replace(parameters=keys)


_OPTIONS_KEPT: ContextVar[bool] = ContextVar("options_kept", default=False)


@contextmanager
def options_kept() -> Iterator[None]:
    """Keep options of the command line in refusals, which name arguments of the outermost call from Python instead."""
    before = _OPTIONS_KEPT.set(True)
    try:
        yield
    finally:
        _OPTIONS_KEPT.reset(before)


_OPTION = re.compile(
    r"(?P<command>(?:maskfab|dask|pip) [a-z][^.;,:]*)|(?P<all>(?P<first>(?<![\w-])--(?P<name>[a-z][a-z-]*))"
    r"(?: (?P<value>'[^']*'|\"[^\"]*\"|\d[\w.]*|[A-Z]{2,}|[a-z]+://[\w.:]+|[a-z]+))?"
    r"(?: (?P=first) (?P<more>'[^']*'|\"[^\"]*\"))?)"
)
"""A command, which stays as it is; or an option, with what follows it as a value, and once more with another."""
_QUOTES = "'\""
_PLACES = ("out", "path", "place", "directory")
"""Arguments that say where results go."""


def _argument(parameters: Mapping[str, inspect.Parameter], found: re.Match[str]) -> str:
    """The argument of a function in place of an option; an option of another function stays as it is."""
    if found["command"]:
        return found[0]
    option = found["name"]
    word = option.replace("-", "_")
    named = (word, f"{word}s", *(_PLACES if option == "out" else ()))
    name = next((other for other in named if other in parameters), None)
    name = name or next((n for n, held in parameters.items() if f"--{option} " in str(held.annotation)), None)
    name = name or ({"out": "out", "force": "force"}.get(option))
    if name is None:
        return found[0]
    hint = str(parameters[name].annotation) if name in parameters else "bool" * (name == "force")
    rest = found["all"].removeprefix(found["first"])
    if "bool" in hint:
        return f"{name}=True{rest}"
    value = found["value"]
    if not value or (value.isalpha() and value.islower() and not re.search(rf"\b{value}\b", hint)):
        return (f"{name}=..." if name in _PLACES and found.string != found[0] else name) + rest
    values = [f'"{held.strip(_QUOTES)}"' for held in (value, found["more"]) if held]
    if value[0].isdigit():
        values = [value]
    return f"{name}=[{', '.join(values)}]" if "Sequence" in hint else f"{name}={values[0]}"


def _require(value: object, hint: Any, where: str) -> None:
    if _fits(value, hint):
        return
    shown = repr(value)
    shown = shown if len(shown) <= _SHOWN else f"{type(value).__name__} {shown[:_SHOWN]}..."
    if isinstance(value, Real) and not _finite(value) and _fits(1.0, hint):
        raise JobError("MF104", f"{shown} is not finite", where=where, cure="Give a finite number")
    made = _MADE.get(getattr(hint, "__name__", ""), "")
    raise JobError("MF105", f"{shown} is not {_words(hint)}", where=where, cure=f"Give {_words(hint)}{made}")


def _evaluated(annotation: Any, names: Mapping[str, Any]) -> Any:
    """The type that an annotation's text stands for; what may be made an array is not looked at."""
    while isinstance(annotation, str):
        annotation = eval(annotation, {}, _Names({**names, "ArrayLike": _Anything}))
    return _Anything if annotation is inspect.Parameter.empty else annotation


class _Anything:
    """Any type that only type checkers know."""

    def __class_getitem__(cls, key: object) -> type:
        return cls


class _Names(dict[str, Any]):
    """Names of a module and of Python; any other stands for anything."""

    def __getitem__(self, key: str) -> Any:
        value = self.get(key, getattr(builtins, key, _Anything))
        # An alias may be text itself.
        return _evaluated(value, self) if isinstance(value, str) else value


def _fits(value: object, hint: Any) -> bool:
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _fits(value, inner[0])
    if origin in (Union, types.UnionType):
        return any(_fits(value, kind) for kind in inner)
    if origin is Literal:
        # What the words mean, and which there are, is told where they are used.
        return any(type(value) is type(kind) for kind in inner)
    if origin is np.ndarray:
        return isinstance(value, np.ndarray)
    if isinstance(origin, type) and issubclass(origin, Mapping | Sequence):
        return _each_fits(value, origin, inner)
    if origin is Callable:
        return callable(value)
    if hint in (_Anything, Any):
        return True
    if hint in (None, type(None)):
        return value is None
    if hint is float:
        return isinstance(value, Real) and not isinstance(value, bool) and _finite(value)
    if hint is int:
        return isinstance(value, Integral) and not isinstance(value, bool)
    if hint is bool:
        return isinstance(value, bool | np.bool_)
    if hint is Path or origin is PathLike:
        return isinstance(value, PathLike)
    return not isinstance(hint, type) or isinstance(value, hint)


def _each_fits(value: object, origin: type, inner: tuple[Any, ...]) -> bool:
    """Whether a mapping or a list is one, and all that it holds is of its kind."""
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            _fits(key, inner[0]) and _fits(held, inner[1]) for key, held in value.items()
        )
    if isinstance(value, np.ndarray):
        return inner[0] in (int, float) and all(_fits(item, inner[0]) for item in value)
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        return False
    # What a pair holds is told where it is used.
    return origin is tuple or all(_fits(item, inner[0]) for item in value)


def _finite(value: Real) -> bool:
    """Whether a float holds a number, too."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _words(hint: Any) -> str:
    """A type in words."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin is Annotated:
        return _words(inner[0])
    if origin in (Union, types.UnionType):
        words = list(dict.fromkeys(_words(kind) for kind in inner))
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
    if origin is Literal:
        return ", ".join(repr(word) for word in inner)
    if origin is np.ndarray:
        return "an array"
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "a mapping by name"
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return "a list"
    return _WORDS.get(hint) or f"a {getattr(hint, '__name__', hint)}"
