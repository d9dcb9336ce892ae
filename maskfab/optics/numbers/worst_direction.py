"""The MTF at stated frequencies, in the direction in which it is lowest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from maskfab.model import Mtf, Quantity


def worst_directions(mtf: Mtf, frequencies_cy_per_mm: Sequence[float], die: str | None) -> list[Quantity]:
    """The radial minimum at each frequency.

    Args:
        mtf: of one wavelength.
        frequencies_cy_per_mm: on the sensor, at most half a cycle per pixel.
        die: whose numbers these are.

    Notes:
        Between two rings the minimum is interpolated; it may lie anywhere between theirs, so that the error holds both.
    """
    rings, least = mtf.frequency_cy_per_mm, mtf.cuts["radial_min"]
    found = []
    for frequency in frequencies_cy_per_mm:
        value = float(np.interp(frequency, rings, least))
        after = int(np.clip(np.searchsorted(rings, frequency), 1, rings.size - 1))
        near = least[after - 1 : after + 1] if frequency < rings[after] else least[after : after + 1]
        found.append(
            Quantity(
                f"mtf_worst_{frequency:g}",
                value,
                f"radial minimum of the presampled MTF at {frequency:g} cy/mm, between rings interpolated",
                uncertainty=mtf.uncertainty + float(np.abs(near - value).max()),
                die=die,
                wavelength_nm=mtf.wavelength_nm,
            )
        )
    return found
