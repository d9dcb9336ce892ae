"""Probes: how far a plan's own arithmetic errs, told by the same PSF worked out more closely.

A PSF with a phase is held against one whose field errs a hundred times less, one in single precision against double.
Both lie on all samples of the window: few samples miss the orders of a periodic panel, and a strong phase takes the
light away from where any guess would have it.

Notes:
    Phases that take the same degree on the same dots err in step with the bound of their field, so the largest of each
    kind is probed. Other places and lines, and phases of the same kind, err by about as much; ``PROBE_SAFETY`` covers
    them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from maskfab.job.camera import Camera
from maskfab.optics.field.matrix import ParityField
from maskfab.optics.field.methods import FieldPath, FieldTask
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import PhasedPupil, phased, phased_psf, window_frequency
from maskfab.optics.pupil import Pupil
from maskfab.optics.stop import Waves

PROBE_SAFETY = 3.0
"""Factor in what a probe finds."""

ROUNDING = 1e-12
"""Error of double precision, below which no probe tells anything."""

_CLOSER = 1e-2
# A bound too small to probe stands for itself: a hundredth of it is lost in the moments' rounding.
_LEAST_PROBED = 1e-10

# Single rounding is of chance: so many wavelengths, up to this multiple of the shortest, and four units of it at least.
_TRIALS, _STRETCH = 8, 1.3
_LEAST_SINGLE = 4 * float(np.finfo(np.float32).eps)


def phased_error(
    pupil: Pupil,
    camera: Camera,
    phases: Iterable[tuple[float, Waves]],
    tolerance: float,
    distance_um: float,
    *,
    between: bool = False,
) -> float:
    """Relative L2 error of phased PSFs over the camera's window, safety included.

    Args:
        phases: wavelengths in nanometres, and the phase at each.
        tolerance: of the fields, relative to all energy.
        distance_um: from lens to sensor.
        between: whether phases between those given occur too, as over a range of depths.

    Raises:
        JobError: MF115 if a phase turns too fast for the tolerance, or for a hundredth of what it leaves.
    """
    largest: dict[tuple[float, int], tuple[PhasedPupil, float, Waves]] = {}
    for line, waves in phases:
        source = phased(pupil, waves, window_frequency(camera, line, distance_um), tolerance)
        kind = -source.pupil.x.dot_um, source.degree
        if kind not in largest or source.error > largest[kind][0].error:
            largest[kind] = source, line, waves
    worst = ROUNDING
    for kind, (source, line, waves) in largest.items():
        error = source.error
        # Between two kinds the coarser one is taken until its bound reaches the tolerance.
        grown = tolerance / error if between and error and kind != max(largest) else 1.0
        if error <= _LEAST_PROBED:
            worst = max(worst, 4 * error * grown)
            continue
        closer = phased(source.pupil, waves, source.highest, _CLOSER * error)
        rough, fine = (phased_psf(each, camera, line, distance_um=distance_um) for each in (source, closer))
        worst = max(worst, PROBE_SAFETY * grown * relative_difference(rough, fine))
    return worst


def single_error(pupil: Pupil, path: FieldPath, highest: float, count: int, lines_nm: Sequence[float]) -> float | None:
    """Relative L2 error of the PSF by a path in single precision, safety included; None if it refuses the frequencies.

    Args:
        path: one that has single precision.
        highest: of the window at the shortest line, cycles per micrometre.
        count: samples from the axis to the window's edge.
        lines_nm: wavelengths, ascending; some more between and beyond them are tried, as rounding is of chance.
    """
    shortest = lines_nm[0]
    tried = {*lines_nm, *np.linspace(shortest, max(lines_nm[-1], _STRETCH * shortest), _TRIALS).tolist()}
    grids = [np.linspace(0.0, highest * shortest / line, count) for line in tried]
    accepted = [u for u in grids if path.refusal(FieldTask.of(pupil, u, u)) is None]
    if not accepted:
        return None
    exact, single = (path.prepare(pupil, highest, highest, precision) for precision in ("double", "single"))
    worst = max(_apart(single.field(u, u), exact.field(u, u)) for u in accepted)
    return max(_LEAST_SINGLE, PROBE_SAFETY * worst)


def _apart(found: ParityField, true: ParityField) -> float:
    """Relative L2 between two intensities."""
    exact = true.intensity()
    return float(np.linalg.norm(found.intensity() - exact) / np.linalg.norm(exact))
