"""A given opening with fewer clear dots: for comparing designs at equal light with one that was drawn for more."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.camera.photo_camera import PhotoCamera
from maskfab.camera.photographs import Photograph
from maskfab.camera.transfer import lattice
from maskfab.errors import JobError
from maskfab.model import Opening, frozen
from maskfab.opening.clear_dots import closed
from maskfab.optimiser.model.expected_psnr import surrogate_behind
from maskfab.optimiser.result import camera_facts
from maskfab.optimiser.rules.discrete import ExpectedPsnr, Objective
from maskfab.progress import Progress, silent


def reduced_opening(
    opening: Opening,
    clear_dots: int,
    camera: PhotoCamera,
    scenes: Sequence[Photograph],
    command: str,
    *,
    periodic: bool = False,
    progress: Progress = silent,
) -> Opening:
    """The opening with those dots closed that photographs, restored, miss least.

    Args:
        opening: what to reduce; its emitters are left out, as they may lie where there was light.
        clear_dots: how many stay clear.
        camera: that looks through it.
        scenes: photographs whose spectrum and edges count.
        command: for the provenance.
        periodic: whether all cells are laid alike; otherwise each is turned at random.
        progress: told where the work stands.

    Raises:
        JobError, OpeningError: as :func:`reduced`; MF104, MF106, MF121, MF135 as a search for such an opening.
    """
    estimate = surrogate_behind(scenes, lattice(opening.dots, opening.dot_nm, camera=camera, where=opening.name))
    mask = reduced(opening.mask, clear_dots, ExpectedPsnr(estimate, periodic), progress)
    made = {"author": "maskfab", "command": command, "version": __version__, "from": opening.name}
    return Opening(f"{opening.name}_{clear_dots}", mask, opening.dot_nm, made | camera_facts(camera))


def reduced(
    unit: NDArray[np.bool_], clear_dots: int, objective: Objective, progress: Progress = silent
) -> NDArray[np.bool_]:
    """Close the least useful dots of an opening one after the other, each where the objective loses least.

    Args:
        unit: bool [dots, dots].
        clear_dots: how many stay clear.
        objective: higher is better; asked for every clear dot at every step.
        progress: told how many dots are closed.

    Raises:
        JobError, OpeningError: as :func:`require_count`.
    """
    require_count(unit, clear_dots)
    mask = np.array(unit, dtype=np.bool_)
    surplus = int(mask.sum()) - clear_dots
    for step in range(surplus):
        progress("dots", step, surplus)
        worths = []
        places = np.argwhere(mask)
        for row, column in places:
            mask[row, column] = False
            worths.append(objective(mask))
            mask[row, column] = True
        row, column = places[int(np.argmax(worths))]
        mask[row, column] = False
        progress("dots", step + 1, surplus)
    return frozen(mask)


def require_count(unit: NDArray[np.bool_], clear_dots: int) -> None:
    """Refuse to leave no dot clear, or more than there are.

    Raises:
        OpeningError: MF203 for no clear dots.
        JobError: MF104 for more clear dots than the opening has.
    """
    where, count = "clear_dots", int(unit.sum())
    if clear_dots < 1:
        raise closed(clear_dots, unit.size, where=where)
    if clear_dots > count:
        what = f"{clear_dots} dots are to be clear, and the opening has {count}"
        raise JobError("MF104", what, where=where, cure=f"Set clear_dots to {count} or fewer")
