r"""A camera's colour matrix by a colour chart in a photograph, whose patches and their true colours a table states.

With the light x of a patch in balanced colours and r its colour in linear sRGB, the matrix M makes

    Σ w |M x - r|²,        1 / w = v + (0.02 Y + 0.002)²,

least: v is the noise of the patch's mean, Y its luminance, and charts are known to some hundredths of their light. How
bright the chart was lit and exposed goes into M.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.record import Record
from maskfab.errors import SourceError
from maskfab.optics.light.response import curves_text, numeric_table
from maskfab.optics.numbers.colour import LUMINANCE, delta_e_1976, lab_of_linear_srgb, linear_srgb_of_lab_d50

_PLACE = ("row", "column", "size")
_RGB, _LAB = ("red", "green", "blue"), ("L", "a", "b")
_COLUMNS = f"{', '.join(_PLACE)}, and {', '.join(_RGB)} of linear sRGB or {', '.join(_LAB)} against D50"
_SMALLEST = 4.0
_FEWEST = 6
_KNOWN, _KNOWN_DARK = 0.02, 0.002
_SEEN = 5.0
"""Standard errors above black from which a patch is not dark."""
_APART = 0.01
"""Least singular value of the patches' colours over the largest: below, they are of one colour, or of two."""
_CURE = "Give 6 patches or more of different colours, neither full nor dark, by rows and columns of the photograph"


@dataclass(frozen=True, eq=False)
class Patches:
    """The patches of a chart in a photograph.

    Attributes:
        name: of the table.
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
        left_out: sentences on patches that were not used.
    """

    matrix: Floats
    delta_e: Floats
    delta_e_left_out: Floats
    left_out: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """For a document."""
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
        told = self.to_dict()
        return (
            f"colour matrix by {told['patches']} patches: CIE 1976 difference {told['delta_e_mean']:.2f} ± "
            f"{told['delta_e_standard_error']:.2f} (standard error), {told['delta_e_largest']:.2f} at most; "
            f"{told['delta_e_of_each_by_the_others']:.2f} of each patch by the others"
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
        raise SourceError(
            "MF303", f"the columns are {', '.join(header)}", where=where, cure=f"Name the columns {_COLUMNS}"
        )
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
        record: that it was restored from, of as many pixels.
        balance: of the colours.
        binned: pixels of the photograph along the side of one of ``light``.

    Raises:
        SourceError: MF355 for a patch outside, fewer than 6 that can be used, or patches of one colour.
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
    if len(used) < _FEWEST:
        raise _useless(patches.name, f"{len(used)} patches can be used; the least is {_FEWEST}")
    seen, true, noise = np.array(means), patches.colours[used], np.array(variances)
    weights = 1 / (noise + np.square(_KNOWN * np.maximum(true @ LUMINANCE, 0) + _KNOWN_DARK))
    spread = np.linalg.svd(seen / np.linalg.norm(seen, axis=1, keepdims=True), compute_uv=False)
    if spread[-1] < _APART * spread[0]:
        raise _useless(patches.name, "the patches do not differ in colour enough to tell nine numbers")

    def solved(kept: NDArray[np.bool_]) -> Floats:
        root = np.sqrt(weights[kept])[:, None]
        return np.asarray(np.linalg.lstsq(seen[kept] * root, true[kept] * root, rcond=None)[0].T)

    def off(matrix: Floats) -> Floats:
        return delta_e_1976(lab_of_linear_srgb(seen @ matrix.T), lab_of_linear_srgb(true))

    everyone = np.ones(len(used), dtype=np.bool_)
    matrix = solved(everyone)
    alone = [off(solved(np.arange(len(used)) != k))[k] for k in range(len(used))]
    return ChartMatrix(matrix, off(matrix), np.array(alone), tuple(left_out))


def _useless(where: str, why: str) -> SourceError:
    return SourceError("MF355", why, where=where, cure=_CURE)
