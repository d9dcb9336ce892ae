"""Expected restored PSNR of one panel in the conditions of a scene, by the transfer that photographs are taken by.

Of each distance and place it is the die's own transfer (:mod:`maskfab.camera.die_transfer`), as the plan has it, with
the gap's shift and diffraction, depth and aberrations; the middle line stands for all. As in photographs, the camera
knows the blur of the axis at the distance of what is photographed, and restores the whole picture by it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from maskfab.camera.die_transfer import DieTransfer, die_transfer
from maskfab.model import Panel
from maskfab.optics.wavefront.panel_gap import AXIS
from maskfab.optimiser.model.layout_error import PupilError, Transfers
from maskfab.optimiser.model.scene_conditions import Condition, SceneConditions

_MIDDLE = 1


@dataclass(frozen=True)
class SceneAppraisal:
    """A panel's expected restored PSNR over a scene, dB.

    Attributes:
        conditions: of a scene, distance by distance.
        psnr: in each of them, by level, with the ε that is best for all of its photograph.
        mean: by level, over the distances, of photographs with the mean error of their places.
    """

    conditions: tuple[Condition, ...]
    psnr: tuple[tuple[float, ...], ...]
    mean: tuple[float, ...]


def appraise_over(panel: Panel, seen: SceneConditions, errors: Sequence[PupilError]) -> SceneAppraisal:
    """Appraise a panel.

    Args:
        panel: that covers the stop from every place.
        seen: the conditions.
        errors: for each distance, that of panels in its light, or one for all; scenes and noise are taken from it.

    Raises:
        JobError: as :func:`maskfab.camera.die_transfer.die_transfer`.
    """
    each_error = tuple(errors) if len(errors) > 1 else tuple(errors) * len(seen.distances_um)
    places, shares = zip(*seen.places, strict=True)
    psnr: list[tuple[float, ...]] = []
    means = []
    for distance, error in zip(seen.distances_um, each_error, strict=True):
        die = die_transfer("the design", panel, seen.camera, seen.scene, seen.plan, object_um=distance)
        lines, samples = die.resolution.lines[_MIDDLE], die.resolution.samples
        open_share = die.view.passed_um2(lines.gap.centroid_nm, samples) / seen.camera.stop.area_um2
        axis = transfers(die, error)
        by_place = np.stack(
            [
                error.squared_errors(axis, open_share)
                if place == AXIS
                else error.squared_errors(transfers(die.at(place), error), open_share, known=axis)
                for place in places
            ]
        )
        whole = np.tensordot(np.array(shares), by_place, axes=1)
        best = whole.argmin(axis=1)
        means.append([error.decibels(level, whole[k, best[k]]) for k, level in enumerate(error.levels)])
        psnr += [
            tuple(error.decibels(level, each[k, best[k]]) for k, level in enumerate(error.levels)) for each in by_place
        ]
    return SceneAppraisal(tuple(seen), tuple(psnr), tuple(np.mean(means, axis=0).tolist()))


def transfers(die: DieTransfer, error: PupilError) -> Transfers:
    """H of the middle line at the frequencies that an error is summed over."""
    lines, samples = die.resolution.lines[_MIDDLE], die.resolution.samples
    square, low = (die.view.transfer(lines, samples, y, x) for y, x in error.frequencies)
    return square, low
