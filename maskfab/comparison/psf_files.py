"""Written PSFs against those that were measured: every sample, and every entry of the header, read by OpenImageIO."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.export.images.exr import PREFIX, Facts
from maskfab.export.images.psf_exr import PsfFile
from maskfab.model import Quantity
from maskfab.readers.exr_facts import damaged, read_channels

_CURE = "Run the job again to rewrite it"
_OF_ITSELF, _OF_PEAK = 1e-6, 1e-9
"""Float32 rounds to 6e-8 of a value; another machine's sums differ by some 1e-12 of the peak."""


def check_psf_file(made: PsfFile, folder: Path) -> tuple[Quantity, Quantity]:
    """Read a PSF back and compare it with the one that was measured.

    Returns:
        ``psf_file_wrong_samples``, samples that differ by more than a millionth of themselves, all of them if their
        number is another; and ``psf_file_wrong_facts``, entries of the header that are missing, differ or were not
        written. The limit of both is 0.

    Raises:
        SourceError: MF301 if there is no such file, MF303 if it cannot be read.
    """
    values, facts = read_psf_file(folder / made.name)
    expected = made.psf.values
    if values.shape != expected.shape:
        wrong = max(values.size, expected.size)
    else:
        allowed = _OF_ITSELF * abs(expected) + _OF_PEAK * expected.max()
        wrong = int(np.count_nonzero(~(abs(values - expected) <= allowed)))
    differing = tuple(_differing(made.facts, facts))

    def judged(name: str, count: int, method: str) -> Quantity:
        where = {"die": made.die.name, "wavelength_nm": made.psf.wavelength_nm}
        return Quantity(name, count, method, limit=0, passed=count == 0, **where)  # type: ignore[arg-type]

    told = f": {', '.join(differing)}" if differing else ""
    return (
        judged("psf_file_wrong_samples", wrong, f"{made.name}, every sample against the PSF that was measured"),
        judged("psf_file_wrong_facts", len(differing), f"{made.name}, every entry of its header{told}"),
    )


def read_psf_file(path: Path) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Samples [y, x], row 0 the lowest, and the entries of the header that are ours, by name.

    Raises:
        SourceError: MF301 if there is no such file, MF303 if it cannot be read or has not one float32 channel.
    """
    found = read_channels(path, PREFIX, _CURE)
    if len(found.names) != 1 or found.stored != "float":
        raise damaged(path, f"{len(found.names)} channels of {found.stored} are not one of float", _CURE)
    return found.values[0, ::-1], found.facts


def _differing(expected: Facts, found: dict[str, Any]) -> Iterator[str]:
    for name in dict.fromkeys((*expected, *found)):
        one, other = expected.get(name), found.get(name)
        if isinstance(one, float) and isinstance(other, float):
            same = np.float32(one) == np.float32(other)
        else:
            same = one == other
        if not same:
            yield f"{name} is {other!r}, not {one!r}"
