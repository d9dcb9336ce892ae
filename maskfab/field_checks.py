"""Refusals of values that a model type cannot hold, whoever builds it: the right kind, finite, and in range.

Every check reads one field of a frozen dataclass and returns at once where it is sound; texts are made only for a
refusal, for some types are built thousands of times in a search.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Collection
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.errors import JobError, OpeningError

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
    return " and ".join(each for each in (to_above, from_below) if each)


def choice(owner: object, name: str, allowed: Collection[Any]) -> None:
    """Require a field to be one of some values (MF105)."""
    value = getattr(owner, name)
    if value not in allowed:
        listed = ", ".join(str(each) for each in allowed)
        raise _refusal("MF105", owner, name, f"{value!r} is none of {listed}", "Use one of the values listed")


def instance(owner: object, name: str, kind: type) -> None:
    """Require a field to be of a type (MF105)."""
    value = getattr(owner, name)
    if not isinstance(value, kind):
        raise _refusal("MF105", owner, name, f"{value!r} is no {kind.__name__}", f"Give a {kind.__name__}")


def refuse(code: str, owner: object, name: str, what: str, cure: str) -> None:
    """Refuse a field for a reason that only its type knows."""
    raise _refusal(code, owner, name, what, cure)


def square_mask(owner: object, name: str) -> NDArray[np.bool_]:
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


def labels(owner: object, name: str, count: int, code: str, cure: str) -> NDArray[np.int8]:
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
