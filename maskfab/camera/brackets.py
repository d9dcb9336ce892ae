r"""Exposures of one scene merged into one record: each pixel's mean with weights 1 / variance, full wells left out.

    x = sum of y_k / v_k over sum of 1 / v_k,        variance 1 / (sum of 1 / v_k),

over the exposures k in which the pixel is below its full well (Granados, Ajdin, Wand, Theobalt, Seidel, Lensch, CVPR
2010). That gives bright light from short exposures and dark from long ones, and halo becomes linear in the light again.

Notes:
    Variances are those of the merged light, which is found twice: first with weights for the shortest exposure's.
    Of readings within noise of a full well those below it count, so light there is told too dark by up to 0.4 standard
    deviations of the longer exposure. Letting the shorter ones decide errs as far to the other side, and loses light.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maskfab.base.arrays import Singles
from maskfab.camera.record import MergedNoise, Noise, Record
from maskfab.errors import JobError


def merged(exposures: Sequence[Record]) -> Record:
    """One record of several of the same light, all in units of one white.

    Args:
        exposures: with their noise and their full wells, in any order.

    Returns:
        A record with the noise of all, and the full well of the shortest: what that one clips is clipped.

    Raises:
        JobError: MF105 without exposures; MF121 if they differ in size.
    """
    if not exposures:
        raise JobError("MF105", "there are no exposures", where="brackets", cure="Give one or more")
    sizes = {record.values.shape for record in exposures}
    if len(sizes) > 1:
        told = ", ".join(f"{columns} x {rows}" for _, rows, columns in sorted(sizes))
        raise JobError("MF121", f"exposures of one scene have {told} pixels", where="brackets", cure="Give one size")
    ordered = sorted(exposures, key=lambda record: _exposures(record)[-1][0].electrons)
    values = ordered[0].values
    for _ in range(2):
        values = _mean(ordered, values)
    taken = [each for record in reversed(ordered) for each in _exposures(record)]
    return Record(values, MergedNoise(tuple(taken)), ordered[0].ceiling, ordered[0].interpolated)


def _exposures(record: Record) -> tuple[tuple[Noise, float], ...]:
    noise = record.noise
    return noise.exposures if isinstance(noise, MergedNoise) else ((noise, record.ceiling),)


def _mean(ordered: Sequence[Record], light: Singles) -> Singles:
    """The merged values, with weights for ``light``; the shortest's own where all are clipped."""
    total, precision = np.zeros_like(light), np.zeros_like(light)
    for record in ordered:
        weight = ~record.clipped / record.noise.variance(light)
        total += weight * record.values
        precision += weight
    return np.divide(total, precision, out=ordered[0].values.copy(), where=precision > 0)
