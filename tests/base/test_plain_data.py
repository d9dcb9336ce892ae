"""Values that become data and are the same again, and data that are refused."""

from __future__ import annotations

import io
import json
import math
import pickle
import struct
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from typing_extensions import TypeAliasType, TypeVar

from maskfab.base.files import RUN, read_state, save_state
from maskfab.base.plain_data import from_data, to_data


class Colour(Enum):
    """An enumeration."""

    RED = "r"


@dataclass(frozen=True, eq=False)
class Small:
    """A record of every kind of field."""

    number: float
    words: Mapping[str, str | float | None]
    of: NDArray[np.floating[Any]]
    colour: Colour = Colour.RED
    side: Literal["x", "y"] = "x"
    deep: tuple[tuple[int, int], ...] = ()
    more: Colour | str | None = None

    def __post_init__(self) -> None:
        if self.number == 7:
            raise ValueError("seven")


def again(value: Any, kind: Any) -> Any:
    return from_data(to_data(value, kind), kind)


@given(st.floats(allow_nan=False) | st.integers() | st.text() | st.none())
def test_leaves_come_back_to_the_last_bit(value):
    found = again(value, float | int | str | None)
    assert (type(found), found) == (type(value), value)
    if isinstance(value, float):
        assert struct.pack("<d", found) == struct.pack("<d", value)


@pytest.mark.parametrize("value", [np.float64(2.675), np.float32(0.1), np.int64(3), np.float64("inf")])
def test_numbers_of_numpy_stay_such(value):
    found = again(value, float)
    assert (type(found), found.tobytes()) == (type(value), value.tobytes())


def test_a_record_comes_back_whole():
    array = np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3) / 7)
    words = MappingProxyType({"b": 1.0, "a": None, "c": "x"})
    given = Small(math.nan, words, array, deep=((1, 2), (3, 4)), more=Colour.RED)
    found = again((given,), tuple[Small, ...])[0]
    assert math.isnan(found.number)
    assert (list(found.words.items()), type(found.words)) == (list(words.items()), MappingProxyType)
    assert (found.of.dtype, found.of.tobytes("A")) == (array.dtype, array.tobytes("A"))
    assert found.of.flags.f_contiguous
    assert (found.colour, found.side, found.deep, found.more) == (Colour.RED, "x", ((1, 2), (3, 4)), Colour.RED)


@pytest.mark.parametrize(
    ("value", "kind"),
    [(3, str), ([1], tuple[int, ...]), ((1, 2, 3), tuple[int, int]), (True, int), (object(), object), (1, Any),
     (np.array([None]), NDArray[np.float64]), (Path(), Path), ({1: 2}, Mapping[str, int])],
)  # fmt: skip
def test_a_value_of_another_kind_is_no_data(value, kind):
    with pytest.raises(TypeError):
        to_data(value, kind)


Scalar = TypeVar("Scalar", bound=np.generic)
Held = TypeVar("Held")
Array = TypeAliasType("Array", np.ndarray[Any, np.dtype[Scalar]], type_params=(Scalar,))
Named = TypeAliasType("Named", dict[str, Held], type_params=(Held,))
Turned = TypeAliasType("Turned", tuple[Held, Scalar], type_params=(Scalar, Held))
Itself = TypeAliasType("Itself", Held, type_params=(Held,))
Fixed = TypeAliasType("Fixed", tuple[int, ...], type_params=(Held,))


@pytest.mark.parametrize(
    ("value", "kind"),
    [(np.arange(3.0), Array[np.float64]), ({"a": 1}, Named[int]), ({"a": ({"b": 2},)}, Named[tuple[Named[int], ...]]),
     ((1, "s"), Turned[str, int]), (3, Itself[int]), ((1, 2), Fixed[str]), ((), TypeAliasType("Void", tuple[()]))],
)  # fmt: skip
def test_a_kind_may_be_named_by_an_alias(value, kind):
    found = again(value, kind)
    assert type(found) is type(value)
    np.testing.assert_array_equal(found, value)


def test_an_alias_holds_what_it_stands_for():
    with pytest.raises(TypeError):
        to_data(np.arange(3), Array[np.float64])
    with pytest.raises(TypeError):
        to_data({"a": "x"}, Named[int])
    with pytest.raises(TypeError):
        to_data(np.arange(3.0), Array)


def test_data_of_another_kind_are_refused():
    data = to_data(Small(1.0, {}, np.zeros(2)), Small)
    for kind in (Colour, int, tuple[Small, ...], NDArray[np.float64]):
        with pytest.raises((ValueError, TypeError)):
            from_data(data, kind)
    with pytest.raises(TypeError):
        from_data(data, object)


def edited(data: bytes, places: Any = None, **changes: Any) -> bytes:
    stored = dict(np.load(io.BytesIO(data)))
    tree, placed = json.loads(stored["tree"].tobytes())
    stored["tree"] = np.frombuffer(json.dumps([tree | changes, places or placed]).encode(), np.uint8)
    buffer = io.BytesIO()
    np.savez(buffer, **stored)
    return buffer.getvalue()


def savez_of_numpy_2_0(file: Any, **arrays: Any) -> None:
    """Every keyword is an array there."""
    with zipfile.ZipFile(file, "w") as members:
        for name, array in arrays.items():
            with members.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, np.asanyarray(array))


def test_data_hold_nothing_more_where_savez_takes_every_keyword_for_an_array(monkeypatch, tmp_path):
    monkeypatch.setattr(np, "savez", savez_of_numpy_2_0)
    given = Small(1.0, {}, np.arange(2.0))
    assert again(given, Small).of.tolist() == [0, 1]
    save_state(tmp_path / "state.npz", "a", {"b": np.arange(3)})
    assert set(read_state(tmp_path / "state.npz")) == {RUN, "b"}


def test_objects_are_written_nowhere(tmp_path):
    with pytest.raises(ValueError, match="objects"):
        save_state(tmp_path / "state.npz", "a", {"b": np.array([None])})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "changes",
    [{"number": 7}, {"number": "1"}, {"number": True}, {"colour": "BLUE"}, {"side": "z"}, {"deep": [[1, 2, 3]]},
     {"of": 0}, {"of": {"array": 1}}, {"of": {"array": -1}}, {"deep": 3}, {"more": [9, None]}, {"more": [0, "posix"]},
     {"__class__": "Popen"}, {"places": [[0, [-1], "C"]]}, {"places": [[0, [3], "C"]]}, {"places": [[0, [1], "C"]]},
     {"places": [[1, [2], "C"]]}, {"places": [[0, [2.0], "C"]]}, {"places": [[0, [2], "C"], [0, [2], "C"]]},
     {"places": 3}],
)  # fmt: skip
def test_edited_data_are_refused(changes):
    data = to_data(Small(1.0, {}, np.zeros(2)), Small)
    assert from_data(edited(data, number=2.0), Small).number == 2
    with pytest.raises((ValueError, TypeError)):
        from_data(edited(data, **changes), Small)


class Planted:
    """A pickle that writes a file when it is read."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def test_no_pickle_is_read(tmp_path):
    planted = tmp_path / "ran"
    for data in (pickle.dumps(Planted(planted)), _with_objects(planted)):
        with pytest.raises(ValueError, match="allow_pickle"):
            from_data(data, NDArray[np.float64])
    assert not planted.exists()


def _with_objects(planted: Path) -> bytes:
    buffer = io.BytesIO()
    array = np.empty(1, dtype=object)
    array[0] = Planted(planted)
    np.savez(buffer, tree=np.frombuffer(b'[{"array": 0}, [[0, [1], "C"]]]', np.uint8), **{"0": array})
    return buffer.getvalue()
