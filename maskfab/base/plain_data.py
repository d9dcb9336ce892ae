"""Values as plain data and back, by the type hints of what they are: JSON and arrays, in one file of numpy's (npz).

Data name no types and hold no code. What they become is settled by the kind that is asked for, of which the fields of
frozen dataclasses state the rest: numbers, words, arrays, tuples, mappings, enumerations, and unions of those.
"""

from __future__ import annotations

import io
import json
import math
import types
import typing
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any, Literal, TypeAlias

import numpy as np

from maskfab.base.arrays import write_arrays

_Array: TypeAlias = np.ndarray[Any, Any]
_TREE = "tree"
_PLACE = "array"
_LEAVES: Mapping[Any, tuple[type, ...]] = types.MappingProxyType(
    {
        bool: (bool, np.bool_),
        int: (int, np.integer),
        # Some numbers are whole though their fields say float, and are told without a point.
        float: (float, int, np.floating, np.integer),
        str: (str,),
        type(None): (type(None),),
    }
)


def to_data(value: object, kind: Any) -> bytes:
    """Bytes from which :func:`from_data` makes an equal value: floats to the last bit, arrays with dtype and shape.

    Args:
        kind: a class, or what a type hint may state.

    Raises:
        TypeError: for a value of another kind, or a kind whose values are no plain data.
    """
    arrays: list[_Array] = []
    tree = _form(kind).down(value, arrays)
    # Those of a type in one: a thousand small members take longer to open than all else to read.
    joined: dict[str, list[_Array]] = {}
    places = []
    for number, array in enumerate(arrays):
        name = f"{number}:" if array.dtype.hasobject or array.dtype.names else array.dtype.str
        order: Literal["C", "F"] = "F" if array.flags.fnc else "C"
        joined.setdefault(name, []).append(array.ravel(order))
        places.append([list(joined).index(name), array.shape, order])
    told = np.frombuffer(json.dumps([tree, places]).encode(), np.uint8)
    buffer = io.BytesIO()
    write_arrays(buffer, {_TREE: told, **{str(k): np.concatenate(parts) for k, parts in enumerate(joined.values())}})
    return buffer.getvalue()


def from_data(data: bytes, kind: Any) -> Any:
    """The value of a kind that data hold; for other data mostly ValueError, and whatever a class raises."""
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        tree, places = json.loads(stored[_TREE].tobytes())
        joined = [stored[str(number)] for number in range(len(stored.files) - 1)]
    begun, arrays = [0] * len(joined), []
    for which, shape, order in places:
        number = _index(which, joined)
        _require(all(type(side) is int and side >= 0 for side in shape), shape, "a shape", ValueError)
        begin, begun[number] = begun[number], begun[number] + math.prod(shape)
        # A copy, for what is kept of it is not to hold all the rest.
        arrays.append(joined[number][begin : begun[number]].reshape(shape, order=order).copy(order))
    _require(begun == [part.size for part in joined], places, "places of arrays", ValueError)
    return _form(kind).up(tree, arrays)


@dataclass(frozen=True)
class _Form:
    """Plain data of one kind of values: whether a value is of it, to what JSON can say (arrays to a list), and back."""

    holds: Callable[[object], bool]
    down: Callable[[Any, list[_Array]], Any]
    up: Callable[[Any, Sequence[_Array]], Any]


@cache
def _form(kind: Any) -> _Form:
    """Way of values of a kind to data and back; TypeError for a kind whose values are none."""
    origin, within = typing.get_origin(kind), typing.get_args(kind)
    # A name for a kind, such as NDArray of numpy 2.5.
    alias = kind if origin is None else origin
    if type(alias).__name__ == "TypeAliasType":
        return _form(_meant(alias, within))
    if kind in _LEAVES:
        return _leaf(kind)
    if kind is bytes:
        return _bytes()
    if origin is typing.Literal:
        return _literal(within)
    if origin in (types.UnionType, typing.Union):
        return _union(tuple(map(_form, within)))
    if origin is np.ndarray:
        scalar = typing.get_args(within[1])[0]
        return _array(typing.get_origin(scalar) or scalar)
    if origin is tuple:
        return _tuple(within)
    if origin in (dict, Mapping):
        return _mapping(within, (dict,) if origin is dict else (dict, types.MappingProxyType))
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _enumeration(kind)
    if isinstance(kind, type) and is_dataclass(kind):
        return _record(kind)
    raise TypeError(f"values of the kind {kind} are no plain data")


def _meant(alias: Any, within: tuple[Any, ...]) -> Any:
    """The type that an alias stands for, its parameters replaced."""
    if not within:
        return alias.__value__
    given = dict(zip(alias.__type_params__, within, strict=True))
    if alias.__value__ in given:
        return given[alias.__value__]
    named = tuple(given[each] for each in getattr(alias.__value__, "__parameters__", ()))
    return alias.__value__[named] if named else alias.__value__


def _leaf(kind: type) -> _Form:
    classes = _LEAVES[kind]

    def holds(value: object) -> bool:
        if isinstance(value, np.generic):
            return isinstance(value, classes)
        return type(value) in classes

    def down(value: Any, _: list[_Array]) -> Any:
        _require(holds(value), value, kind)
        if isinstance(value, np.generic):
            # Numbers of numpy are not rounded as those of Python are.
            _require(np.dtype(value.dtype).itemsize <= np.dtype(np.float64).itemsize, value, kind)
            return {"of": value.dtype.str, "is": value.item()}
        return value

    def up(plain: Any, _: Sequence[_Array]) -> Any:
        value = plain
        if isinstance(plain, dict):
            value = np.dtype(plain["of"]).type(plain["is"])
        _require(holds(value), value, kind, ValueError)
        return value

    return _Form(holds, down, up)


def _bytes() -> _Form:
    def up(place: Any, arrays: Sequence[_Array]) -> bytes:
        return _placed(place, arrays, np.uint8).tobytes()

    def down(value: Any, arrays: list[_Array]) -> dict[str, int]:
        _require(type(value) is bytes, value, bytes)
        return _put(np.frombuffer(value, np.uint8), arrays)

    return _Form(lambda value: type(value) is bytes, down, up)


def _array(scalar: type[np.generic]) -> _Form:
    def holds(value: object) -> bool:
        return type(value) is np.ndarray and issubclass(value.dtype.type, scalar) and not value.dtype.hasobject

    def down(value: Any, arrays: list[_Array]) -> dict[str, int]:
        _require(holds(value), value, scalar)
        return _put(value, arrays)

    return _Form(holds, down, lambda place, arrays: _placed(place, arrays, scalar))


def _literal(values: tuple[Any, ...]) -> _Form:
    def up(plain: Any, _: Sequence[_Array]) -> Any:
        _require(plain in values, plain, values, ValueError)
        return plain

    def down(value: Any, _: list[_Array]) -> Any:
        _require(value in values, value, values)
        return value

    return _Form(lambda value: value in values, down, up)


def _union(arms: tuple[_Form, ...]) -> _Form:
    def arm_of(value: object) -> int:
        return next((number for number, arm in enumerate(arms) if arm.holds(value)), -1)

    def down(value: Any, arrays: list[_Array]) -> Any:
        number = arm_of(value)
        _require(number >= 0, value, "a union")
        return [number, arms[number].down(value, arrays)]

    def up(plain: Any, arrays: Sequence[_Array]) -> Any:
        number, content = plain
        return arms[_index(number, arms)].up(content, arrays)

    return _Form(lambda value: arm_of(value) >= 0, down, up)


def _tuple(kinds: tuple[Any, ...]) -> _Form:
    several = len(kinds) == 2 and kinds[1] is Ellipsis
    forms = tuple(map(_form, kinds[:1] if several else kinds))

    def of(length: int, value: object, error: type[Exception] = TypeError) -> Sequence[_Form]:
        _require(several or length == len(forms), value, kinds, error)
        return forms * length if several else forms

    def down(value: Any, arrays: list[_Array]) -> list[Any]:
        _require(type(value) is tuple, value, tuple)
        return [form.down(item, arrays) for form, item in zip(of(len(value), value), value, strict=True)]

    def up(plain: Any, arrays: Sequence[_Array]) -> tuple[Any, ...]:
        _require(type(plain) is list, plain, tuple, ValueError)
        every = of(len(plain), plain, ValueError)
        return tuple([form.up(item, arrays) for form, item in zip(every, plain, strict=True)])

    return _Form(lambda value: type(value) is tuple, down, up)


def _mapping(kinds: tuple[Any, ...], makers: tuple[Callable[[Any], Any], ...]) -> _Form:
    key, content = map(_form, kinds)

    def down(value: Any, arrays: list[_Array]) -> list[Any]:
        _require(type(value) in makers, value, Mapping)
        return [makers.index(type(value)), [[key.down(k, arrays), content.down(v, arrays)] for k, v in value.items()]]

    def up(plain: Any, arrays: Sequence[_Array]) -> Any:
        maker, pairs = plain
        return makers[_index(maker, makers)]({key.up(k, arrays): content.up(v, arrays) for k, v in pairs})

    return _Form(lambda value: type(value) in makers, down, up)


def _enumeration(kind: type[Enum]) -> _Form:
    def down(value: Any, _: list[_Array]) -> str:
        _require(type(value) is kind, value, kind)
        return str(value.name)

    def up(name: Any, _: Sequence[_Array]) -> Enum:
        _require(name in kind.__members__, name, kind, ValueError)
        return kind[name]

    return _Form(lambda value: type(value) is kind, down, up)


def _record(kind: type) -> _Form:
    hints = typing.get_type_hints(kind)
    forms = {field.name: _form(hints[field.name]) for field in fields(kind)}

    def down(value: Any, arrays: list[_Array]) -> dict[str, Any]:
        _require(type(value) is kind, value, kind)
        return {name: form.down(getattr(value, name), arrays) for name, form in forms.items()}

    def up(plain: Any, arrays: Sequence[_Array]) -> Any:
        _require(isinstance(plain, dict) and plain.keys() == forms.keys(), plain, kind, ValueError)
        # By its own door, so that what the class refuses is refused here.
        return kind(**{name: form.up(plain[name], arrays) for name, form in forms.items()})

    return _Form(lambda value: type(value) is kind, down, up)


def _put(array: _Array, arrays: list[_Array]) -> dict[str, int]:
    arrays.append(array)
    return {_PLACE: len(arrays) - 1}


def _placed(place: Any, arrays: Sequence[_Array], scalar: type[np.generic]) -> _Array:
    _require(isinstance(place, dict) and place.keys() == {_PLACE}, place, scalar, ValueError)
    array = arrays[_index(place[_PLACE], arrays)]
    _require(issubclass(array.dtype.type, scalar), array.dtype, scalar, ValueError)
    return array


def _index(number: Any, among: Sequence[Any]) -> int:
    _require(type(number) is int and 0 <= number < len(among), number, f"one of {len(among)}", ValueError)
    return int(number)


def _require(held: bool, value: object, kind: object, error: type[Exception] = TypeError) -> None:
    if not held:
        raise error(f"{type(value).__name__} {value!r:.60} is not {kind}")
