"""Rules that a clear raster must keep: no kissing corners, nothing narrower than the writer resolves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def corner_touches(clear: NDArray[np.bool_]) -> int:
    """Number of grid vertices at which exactly two of the four cells are clear, and these lie on a diagonal.

    Writers round corners by about 1 µm, so whether such corners join or part is left to chance.

    Args:
        clear: bool [y, x]; vertices on the border of the array touch fewer than four cells and never count.
    """
    lower_left, lower_right, upper_left, upper_right = clear[:-1, :-1], clear[:-1, 1:], clear[1:, :-1], clear[1:, 1:]
    rising = lower_left & upper_right & ~lower_right & ~upper_left
    falling = lower_right & upper_left & ~lower_left & ~upper_right
    return int(np.count_nonzero(rising) + np.count_nonzero(falling))


@dataclass(frozen=True)
class SmallestRuns:
    """The narrowest features of a raster along the grid's axes, in the unit of its edges; inf where there are none.

    Attributes:
        clear_x: shortest clear run along a row.
        clear_y: shortest clear run along a column.
        opaque_x: shortest opaque run along a row.
        opaque_y: shortest opaque run along a column.
    """

    clear_x: float
    clear_y: float
    opaque_x: float
    opaque_y: float

    @property
    def clear(self) -> float:
        """Smallest clear width along either axis."""
        return min(self.clear_x, self.clear_y)

    @property
    def opaque(self) -> float:
        """Smallest opaque space along either axis."""
        return min(self.opaque_x, self.opaque_y)


def smallest_runs(
    clear: NDArray[np.bool_],
    x_edges: NDArray[np.float64] | None = None,
    y_edges: NDArray[np.float64] | None = None,
    *,
    periodic: bool = False,
) -> SmallestRuns:
    """Smallest clear width and smallest opaque space of a raster.

    A run ends where its neighbour differs. If the raster is not periodic, it is taken to be surrounded by chrome, so
    clear runs end at the border and an opaque run that meets the border is no space. If it is periodic, runs continue
    on the opposite side, and a row or column of one tone has no run. Diagonal distances are not looked at; the
    closest of them are :func:`corner_touches`.

    Args:
        clear: bool [ny, nx].
        x_edges: float64 [nx + 1], ascending; whole dots if None.
        y_edges: float64 [ny + 1], ascending, in the same unit; whole dots if None.
        periodic: whether the raster repeats in both directions.
    """
    ny, nx = clear.shape
    x = np.arange(nx + 1.0) if x_edges is None else np.asarray(x_edges, dtype=np.float64)
    y = np.arange(ny + 1.0) if y_edges is None else np.asarray(y_edges, dtype=np.float64)
    shortest = _shortest_periodic if periodic else _shortest
    clear_x, opaque_x = shortest(clear, x)
    clear_y, opaque_y = shortest(clear.T, y)
    return SmallestRuns(clear_x, clear_y, opaque_x, opaque_y)


def _shortest(clear: NDArray[np.bool_], edges: NDArray[np.float64]) -> tuple[float, float]:
    """Shortest clear and shortest opaque run along axis 1, the raster surrounded by chrome."""
    steps = np.diff(np.pad(clear.astype(np.int8), ((0, 0), (1, 1))), axis=1)
    rows, starts = np.nonzero(steps == 1)
    _, stops = np.nonzero(steps == -1)
    spaces = (edges[starts[1:]] - edges[stops[:-1]])[rows[1:] == rows[:-1]]
    return _minimum(edges[stops] - edges[starts]), _minimum(spaces)


def _shortest_periodic(clear: NDArray[np.bool_], edges: NDArray[np.float64]) -> tuple[float, float]:
    """Shortest clear and shortest opaque run along axis 1 of a raster that repeats."""
    rows, cells = np.nonzero(clear != np.roll(clear, 1, axis=1))
    if rows.size == 0:
        return np.inf, np.inf
    starts, tones = edges[cells], clear[rows, cells]
    opens_row = np.append(True, rows[1:] != rows[:-1])
    closes_row = np.append(opens_row[1:], True)
    stops = np.append(starts[1:], 0.0)
    stops[closes_row] = starts[opens_row] + edges[-1] - edges[0]
    lengths = stops - starts
    return _minimum(lengths[tones]), _minimum(lengths[~tones])


def _minimum(lengths: NDArray[np.float64]) -> float:
    return float(lengths.min(initial=np.inf))
