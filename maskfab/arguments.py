"""Arguments of public functions, held against their annotations before any work.

What a value means is judged where it is used; here only its type is, and that a plain number is finite.
"""

from __future__ import annotations

import builtins
import inspect
import math
import types
from collections.abc import Callable, Mapping, Sequence
from functools import cache, wraps
from numbers import Integral, Real
from os import PathLike
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin

import numpy as np

from maskfab.errors import JobError

Given = ParamSpec("Given")
Result = TypeVar("Result")

_WORDS: Mapping[object, str] = types.MappingProxyType(
    {str: "text", Path: "a path", bool: "True or False", int: "a whole number", float: "a number", type(None): "None"}
)
_SHOWN = 60


def checked_arguments(function: Callable[Given, Result]) -> Callable[Given, Result]:
    """For functions that users call: refuses arguments of another type than their annotations say.

    Names that only type checkers import are taken for anything.

    Raises:
        JobError: MF105 for an argument that is missing, unknown or of the wrong type; MF104 for a number that is not
            finite.
    """

    called = function.__qualname__.removesuffix(".__init__")

    @cache
    def expected() -> tuple[inspect.Signature, Mapping[str, Any]]:
        stated, names = inspect.signature(function), inspect.unwrap(function).__globals__
        return stated, {name: _evaluated(each.annotation, names) for name, each in stated.parameters.items()}

    @wraps(function)
    def checked(*args: Given.args, **kwargs: Given.kwargs) -> Result:
        stated, hints = expected()
        try:
            bound = stated.bind(*args, **kwargs)
        except TypeError as error:
            known = ", ".join(name for name in stated.parameters if name not in ("self", "cls"))
            raise JobError("MF105", str(error), where=called, cure=f"The arguments are {known}") from None
        for name, value in bound.arguments.items():
            kind = stated.parameters[name].kind
            if kind is inspect.Parameter.VAR_POSITIONAL:
                each = {f"{name}[{i}]": held for i, held in enumerate(value)}
            elif kind is inspect.Parameter.VAR_KEYWORD:
                each = value
            else:
                each = {name: value}
            for key, held in each.items():
                _require(held, hints[name], f"{called}: {key}")
        return function(*args, **kwargs)

    return checked


def _require(value: object, hint: Any, where: str) -> None:
    if _fits(value, hint):
        return
    told = repr(value)
    told = told if len(told) <= _SHOWN else f"{type(value).__name__} {told[:_SHOWN]}..."
    if isinstance(value, Real) and not _finite(value) and _fits(1.0, hint):
        raise JobError("MF104", f"{told} is not finite", where=where, cure="Give a finite number")
    raise JobError("MF105", f"{told} is not {_words(hint)}", where=where, cure=f"Give {_words(hint)}")


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
        found = self.get(key, getattr(builtins, key, _Anything))
        # An alias may be text itself.
        return _evaluated(found, self) if isinstance(found, str) else found


def _fits(value: object, hint: Any) -> bool:
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return any(_fits(value, each) for each in inner)
    if origin is Literal:
        # What the words mean, and which there are, is told where they are used.
        return any(type(value) is type(each) for each in inner)
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
    if hint is Path:
        return isinstance(value, PathLike)
    return not isinstance(hint, type) or isinstance(value, hint)


def _each_fits(value: object, origin: type, inner: tuple[Any, ...]) -> bool:
    """Whether a mapping or a list is one, and all that it holds is of its kind."""
    if issubclass(origin, Mapping):
        return isinstance(value, Mapping) and all(
            _fits(key, inner[0]) and _fits(held, inner[1]) for key, held in value.items()
        )
    if isinstance(value, np.ndarray):
        return inner[0] in (int, float) and all(_fits(each, inner[0]) for each in value)
    if not isinstance(value, Sequence) or isinstance(value, str | bytes):
        return False
    # What a pair holds is told where it is used.
    return origin is tuple or all(_fits(each, inner[0]) for each in value)


def _finite(value: Real) -> bool:
    """Whether a float holds a number, too."""
    try:
        return math.isfinite(value)
    except OverflowError:
        return False


def _words(hint: Any) -> str:
    """A type in words."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        words = list(dict.fromkeys(_words(each) for each in inner))
        return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"
    if origin is Literal:
        return ", ".join(repr(each) for each in inner)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return "a mapping by name"
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return "a list"
    return _WORDS.get(hint) or f"a {getattr(hint, '__name__', hint)}"
