"""Scenes with less round the sensor than others, and what of a point's light falls farther.

The blur is circular, so beyond its edges a scene repeats. Of the 256 pixels that others have round the sensor, a small
one has 128; how much of a point's light falls farther is told. If half of it does, the scene is smaller than the point
spread, and what is photographed would be its repetition.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.fft

from maskfab.camera.design import Design, RestoredBy
from maskfab.camera.photographs import WIDE, Photograph
from maskfab.camera.restorers.restorer import Blur
from maskfab.camera.restorers.wiener import MARGIN, Margin
from maskfab.errors import JobError

MOST_BEYOND = 0.5
"""Of a point's light, farther than the scene goes on round the sensor."""


def beyond(blur: Blur, margin: Margin) -> float:
    """Share of a point's light that falls farther than the margin is wide along an axis, of the worst colour."""
    shape = margin.shape[0] + 2 * (MARGIN - margin.width), margin.shape[1] + 2 * (MARGIN - margin.width)
    near = np.ix_(*(abs(scipy.fft.fftfreq(side, 1 / side)) <= margin.width for side in shape))
    spreads = (scipy.fft.irfft2(transfer, s=shape, workers=1) for transfer in blur.on(shape))
    return max(1 - float(each[near].sum(dtype=np.float64) / each.sum(dtype=np.float64)) for each in spreads)


def told(design: Design, scenes: Sequence[Photograph]) -> tuple[str, ...]:
    """Sentences on scenes with less than 256 pixels round the sensor, behind a design.

    Raises:
        JobError: MF121 for one that is smaller than the design's point spread.
    """
    blur = design.seen if isinstance(design, RestoredBy) else design
    sentences = []
    for scene in scenes:
        margin = scene.margin
        if margin.width >= MARGIN:
            continue
        rows, columns = margin.shape
        share, size = beyond(blur, margin), f"{columns} x {rows} pixels, {margin.width} of them round the sensor"
        if share > MOST_BEYOND:
            raise JobError(
                "MF121",
                f"the picture has {size}, and {share:.1%} of a point's light falls farther behind {design.name}; the "
                f"limit is {MOST_BEYOND:.0%}, beyond which it is smaller than the point spread",
                where=scene.name,
                cure=f"Give a photograph of {WIDE} x {WIDE} or more, which has {MARGIN} round the sensor",
            )
        sentences.append(
            f"the scene {scene.name} has {size} rather than {MARGIN}: {share:.1%} of a point's light falls farther, "
            "and what comes from beyond the edges is taken from the scene repeated"
        )
    return tuple(sentences)
