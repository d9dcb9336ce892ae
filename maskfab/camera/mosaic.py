"""The colour mosaic of a sensor, and its one linear interpolation.

Every two by two pixels record red, green, green and blue, red in the top left one. A missing colour is the mean of its
neighbours, corrected by the Laplacian of the colour that is there (H. S. Malvar, L. He, R. Cutler, Proc. ICASSP 2004,
485): four filters of five by five, linear, so that what they do to noise and blur follows from the filters alone.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from maskfab.base.arrays import Singles
from maskfab.errors import JobError

_GREEN = np.array([[0, 0, -1, 0, 0], [0, 0, 2, 0, 0], [-1, 2, 4, 2, -1], [0, 0, 2, 0, 0], [0, 0, -1, 0, 0]]) / 8
_ALONG = np.array([[0, 0, 0.5, 0, 0], [0, -1, 0, -1, 0], [-1, 4, 5, 4, -1], [0, -1, 0, -1, 0], [0, 0, 0.5, 0, 0]]) / 8
_ACROSS = (
    np.array([[0, 0, -1.5, 0, 0], [0, 2, 0, 2, 0], [-1.5, 0, 6, 0, -1.5], [0, 2, 0, 2, 0], [0, 0, -1.5, 0, 0]]) / 8
)
_RED, _BLUE = (slice(0, None, 2), slice(0, None, 2)), (slice(1, None, 2), slice(1, None, 2))
_ON_RED_ROWS, _ON_BLUE_ROWS = (slice(0, None, 2), slice(1, None, 2)), (slice(1, None, 2), slice(0, None, 2))


def sampled(light: Singles) -> Singles:
    """The one colour that every pixel records, [rows, columns] of [3, rows, columns].

    Raises:
        JobError: MF140 for odd sides.
    """
    rows, columns = light.shape[1:]
    if rows % 2 or columns % 2:
        raise JobError(
            "MF140",
            f"a mosaic of 2 x 2 pixels does not fill {columns} x {rows}",
            where="sensor.mosaic",
            cure="Cut the photographs to even sides",
        )
    seen = np.array(light[1])
    seen[_RED], seen[_BLUE] = light[0][_RED], light[2][_BLUE]
    return seen


def interpolated(seen: Singles, red: tuple[int, int] = (0, 0)) -> Singles:
    """All three colours of every pixel, [3, rows, columns]; what was recorded stays as it is.

    Args:
        seen: [rows, columns] what every pixel recorded; even sides where red is not in the top left pixel.
        red: row and column, 0 or 1, of the uppermost left red pixel; blue is diagonal to it.
    """
    # Turned over, an even side's last pixel has the colour that its second one had.
    turned = tuple(axis for axis in (0, 1) if red[axis])
    found = _of_red_first(np.flip(seen, turned))
    return np.flip(found, tuple(axis + 1 for axis in turned))


def _of_red_first(seen: Singles) -> Singles:
    # Mirroring without doubling the edge keeps every colour on its own places.
    green, along, across = (
        ndimage.correlate(seen, each.astype(np.float32), mode="mirror") for each in (_GREEN, _ALONG, _ACROSS)
    )
    down = ndimage.correlate(seen, _ALONG.T.astype(np.float32), mode="mirror")
    found = np.stack([seen, seen, seen])
    for place in (_RED, _BLUE):
        found[1][place] = green[place]
    for colour, other, beside, above in (
        (0, _BLUE, _ON_RED_ROWS, _ON_BLUE_ROWS),
        (2, _RED, _ON_BLUE_ROWS, _ON_RED_ROWS),
    ):
        found[colour][other] = across[other]
        found[colour][beside] = along[beside]
        found[colour][above] = down[above]
    return found
