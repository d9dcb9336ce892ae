"""Where the light of a pixel comes from: the mean place of its emitters, each colour with its share of white."""

from __future__ import annotations

import numpy as np

from maskfab.model import Emitters
from maskfab.optics.numbers.colour import LUMINANCE


def luminance_centroid(emitters: Emitters, pitch_nm: int) -> tuple[float, float]:
    """Offset (x, y) of the light's centroid from the pixel's centre, in pixels; every colour sends its share of white.

    Colours weigh the same whatever their areas; those without area send nothing, and (0, 0) is the answer if all are.
    """
    labels = emitters.labels
    n = labels.shape[0]
    total, moment = 0.0, np.zeros(2)
    for colour, share in enumerate(LUMINANCE.tolist(), 1):
        rows, columns = (labels == colour).sum(axis=1), (labels == colour).sum(axis=0)
        area = rows.sum()
        if area:
            total += share
            moment += [share * (line @ np.arange(n) / area + 0.5 - n / 2) for line in (rows, columns)]
    if not total:
        return 0.0, 0.0
    y, x = moment / total * emitters.cell_nm / pitch_nm
    return float(x), float(y)
