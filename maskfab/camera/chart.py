"""Colour charts in photographs: their patches, the colour matrix that they give, and whether they are read rightly.

A colour chart, whose patches and their true colours a table states, gives the colour matrix. With the light x of a
patch in balanced colours and r its colour in linear sRGB, the matrix M makes

    Σ w |M x - r|²,        1 / w = v + (0.02 Y + 0.002)²,

least: v is the noise of the patch's mean, Y its luminance, and charts are known to some hundredths of their light. How
bright the chart was lit and exposed goes into M.

A table in the wrong order fits no matrix. So other readings are tried: the chart turned or mirrored, patches taken for
those whose colours they come nearest to by the fit, and the fit made anew. One that leaves a quarter of the sum of the
reading as stated, or less, shows that the table is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize

from maskfab.base.arrays import Floats, Indices, Mask, Singles
from maskfab.base.errors import SourceError
from maskfab.camera.record import Record
from maskfab.optics.colour import LUMINANCE, delta_e_1976, lab_of_linear_srgb, linear_srgb_of_lab_d50
from maskfab.optics.response import curves_text, numeric_table

_PLACE = ("row", "column", "size")
_RGB, _LAB = ("red", "green", "blue"), ("L", "a", "b")
_COLUMNS = f"{', '.join(_PLACE)}, and {', '.join(_RGB)} of linear sRGB or {', '.join(_LAB)} against D50"
_SMALLEST = 4.0
_FEWEST_PATCHES = 6
_KNOWN, _KNOWN_DARK = 0.02, 0.002
_SEEN = 5.0
"""Standard errors above black from which a patch is not dark."""
_APART = 0.01
"""Least singular value of the patches' colours over the largest: below, they are of one colour, or of two."""
_ROUNDS = 3
_WRONG = 0.25
"""Share of what the stated order leaves at which another is right."""
_WAYS = {
    "the chart stands upside down": ((-1, 0), (0, -1)),
    "the chart is mirrored": ((1, 0), (0, -1)),
    "the chart is mirrored and upside down": ((-1, 0), (0, 1)),
    "the chart is turned by 90 degrees": ((0, 1), (-1, 0)),
    "the chart is turned by 90 degrees the other way": ((0, -1), (1, 0)),
}
_CURE = "Give 6 patches or more of different colours, neither full nor dark, by rows and columns of the photograph"


@dataclass(frozen=True, eq=False)
class Patches:
    """The patches of a chart in a photograph.

    Attributes:
        rows, columns: of their middles, the upper left pixel is 0, [n].
        sizes: of squares within them, in pixels, [n].
        colours: linear sRGB, white is 1, [n, 3].
    """

    name: str
    rows: Floats
    columns: Floats
    sizes: Floats
    colours: Floats


@dataclass(frozen=True, eq=False)
class ChartMatrix:
    """A colour matrix, and how well it does.

    Attributes:
        matrix: [3, 3] from balanced colours to linear sRGB.
        delta_e: CIE 1976 of every patch that was used, [n].
        delta_e_left_out: the same of each patch by the matrix of all others, [n].
    """

    matrix: Floats
    delta_e: Floats
    delta_e_left_out: Floats
    left_out: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Numbers for a document."""
        return {
            "matrix": self.matrix.tolist(),
            "patches": len(self.delta_e),
            "left_out": list(self.left_out),
            "delta_e_mean": float(self.delta_e.mean()),
            "delta_e_standard_error": float(self.delta_e.std(ddof=1) / len(self.delta_e) ** 0.5),
            "delta_e_largest": float(self.delta_e.max()),
            "delta_e_of_each_by_the_others": float(self.delta_e_left_out.mean()),
        }

    def __str__(self) -> str:
        numbers = self.to_dict()
        return (
            f"colour matrix by {numbers['patches']} patches: CIE 1976 difference {numbers['delta_e_mean']:.2f} ± "
            f"{numbers['delta_e_standard_error']:.2f} (standard error), {numbers['delta_e_largest']:.2f} at most; "
            f"{numbers['delta_e_of_each_by_the_others']:.2f} of each patch by the others"
        )


def read_patches(path: Path) -> Patches:
    """Patches from a table whose header is ``row,column,size`` and ``red,green,blue`` or ``L,a,b``.

    Args:
        path: a .csv; lines that begin with ``#`` are skipped.

    Raises:
        SourceError: MF308 for another suffix, MF301 missing, MF302 empty, MF304 not text; MF303 for a header, row or
            number that is damaged; MF355 for values that no patch has.
    """
    where = str(path)
    header, numbers = numeric_table(curves_text(path, where, _COLUMNS), where, _PLACE[:1])
    if tuple(header) not in ((*_PLACE, *_RGB), (*_PLACE, *_LAB)):
        what = f"the columns are {', '.join(header)}"
        raise SourceError("MF303", what, where=where, cure=f"Name the columns {_COLUMNS}")
    if not np.isfinite(numbers).all():
        raise SourceError("MF303", "a value is not finite", where=where, cure="Write every row with numbers alone")
    rows, columns, sizes = numbers[:, :3].T
    if sizes.min() < _SMALLEST:
        raise _useless(where, f"a patch of {sizes.min():g} pixels is below {_SMALLEST:g}")
    stated = numbers[:, 3:]
    if tuple(header[3:]) == _LAB:
        if stated[:, 0].min() < 0 or stated[:, 0].max() > 100:
            raise _useless(where, "a lightness L is outside 0 to 100")
        stated = linear_srgb_of_lab_d50(stated)
    elif stated.min() < -1 or stated.max() > 2:
        raise _useless(where, f"a value of {abs(stated).max():g} is no light of linear sRGB, of which white is 1")
    return Patches(path.name, rows, columns, sizes, stated)


def chart_matrix(
    patches: Patches, light: Singles, record: Record, balance: Sequence[float], binned: int = 1
) -> ChartMatrix:
    """The matrix that makes a photograph's patches their stated colours.

    Args:
        patches: in pixels of the photograph as it was taken.
        light: of the restored photograph in balanced colours, [3, rows, columns].
        binned: pixels of the photograph along the side of one of ``light``.

    Raises:
        SourceError: MF355 for a patch outside, fewer than 6 that can be used, or patches of one colour; MF356 for
            patches in another order than stated.
    """
    _, rows, columns = light.shape
    means, variances, used, left_out = [], [], [], []
    for number, (row, column, size) in enumerate(zip(patches.rows, patches.columns, patches.sizes, strict=True), 1):
        top, left = ((at + 0.5 - size / 2) / binned for at in (row, column))
        bottom, right = (first + size / binned for first in (top, left))
        if top < 0 or left < 0 or bottom > rows or right > columns:
            raise _useless(
                patches.name,
                f"patch {number} at row {row:g}, column {column:g} reaches beyond the {columns * binned} x "
                f"{rows * binned} pixels that are restored",
            )
        box = (slice(None), slice(round(top), max(round(bottom), round(top) + 1)), slice(round(left), round(right)))
        if record.clipped[box].any():
            left_out.append(f"patch {number} is full")
            continue
        mean = light[box].mean(axis=(1, 2), dtype=np.float64)
        own = np.asarray(mean / balance, dtype=np.float32)
        variance = record.noise.variance(own) / light[box][0].size * np.square(balance)
        if (mean < _SEEN * np.sqrt(variance)).any():
            left_out.append(f"patch {number} is dark")
            continue
        means.append(mean)
        variances.append(float(variance.mean()))
        used.append(number - 1)
    if len(used) < _FEWEST_PATCHES:
        raise _useless(patches.name, f"{len(used)} patches can be used; the least is {_FEWEST_PATCHES}")
    seen, true, noise = np.array(means), patches.colours[used], np.array(variances)
    weights = 1 / (noise + np.square(_KNOWN * np.maximum(true @ LUMINANCE, 0) + _KNOWN_DARK))
    spread = np.linalg.svd(seen / np.linalg.norm(seen, axis=1, keepdims=True), compute_uv=False)
    if spread[-1] < _APART * spread[0]:
        raise _useless(patches.name, "the patches do not differ in colour enough to tell nine numbers")

    fit = _Fit(seen, true, weights)
    matrix = fit.matrix()
    _check_order(patches, np.array(used), fit)
    every = np.arange(len(used))
    alone = [fit.off(fit.matrix(every != k))[k] for k in every]
    return ChartMatrix(matrix, fit.off(matrix), np.array(alone), tuple(left_out))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Patches as seen and as stated, [n, 3] each, and their weights [n]."""

    seen: Floats
    true: Floats
    weights: Floats

    def matrix(self, part: Mask | slice = slice(None)) -> Floats:
        root = np.sqrt(self.weights[part])[:, None]
        return np.asarray(np.linalg.lstsq(self.seen[part] * root, self.true[part] * root, rcond=None)[0].T)

    def off(self, matrix: Floats) -> Floats:
        """CIE 1976 difference of every patch."""
        return delta_e_1976(lab_of_linear_srgb(self.seen @ matrix.T), lab_of_linear_srgb(self.true))

    def read(self, order: Indices) -> _Fit:
        return _Fit(self.seen, self.true[order], self.weights[order])

    def left(self) -> float:
        return float(self.weights @ np.square(self.seen @ self.matrix().T - self.true).sum(axis=1))

    def nearest(self) -> Indices:
        """The order in which patches come nearest to stated colours by the matrix of this one."""
        found = lab_of_linear_srgb(self.seen @ self.matrix().T)
        apart = np.linalg.norm(found[:, None] - lab_of_linear_srgb(self.true), axis=2)
        return np.asarray(optimize.linear_sum_assignment(apart)[1])


def _check_order(patches: Patches, used: Indices, fit: _Fit) -> None:
    readings = [*_other_ways(patches, used)]
    nearest = np.arange(used.size)
    for _ in range(_ROUNDS):
        nearest = nearest[fit.read(nearest).nearest()]
    readings.append(("", nearest))
    left, words, order = min(
        ((fit.read(order).left(), words, order) for words, order in readings), key=lambda one: one[0]
    )
    if left > _WRONG * fit.left():
        return
    moved = ", ".join(str(number + 1) for number in used[order != np.arange(used.size)])
    what = words or f"patches {moved} look exchanged"
    better = fit.read(order)
    before, after = (float(one.off(one.matrix()).mean()) for one in (fit, better))
    gain = f"so read, their mean CIE 1976 difference is {after:.1f}, and {before:.1f} as stated"
    raise SourceError("MF356", f"{what}: {gain}", where=patches.name, cure="Correct places or colours in the table")


def _other_ways(patches: Patches, used: Indices) -> Iterator[tuple[str, Indices]]:
    """Orders of a chart that is turned or mirrored, where its patches then lie on places of its patches."""
    places = np.stack([patches.rows, patches.columns], axis=1)[used]
    places = places - (places.min(axis=0) + places.max(axis=0)) / 2
    for words, turned in _WAYS.items():
        apart = np.linalg.norm((places @ np.array(turned))[:, None] - places, axis=2)
        order = apart.argmin(axis=1)
        if (apart.min(axis=1) < patches.sizes[used] / 2).all() and np.unique(order).size == used.size:
            yield words, np.asarray(order)


def _useless(where: str, why: str) -> SourceError:
    return SourceError("MF355", why, where=where, cure=_CURE)
