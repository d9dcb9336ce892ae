"""Restored photographs behind a die: the surrogate's prediction, and photographs simulated through it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from maskfab.camera.laid_panel import laid_panel
from maskfab.camera.photo_camera import F1, PhotoCamera
from maskfab.camera.photographs import Photograph
from maskfab.camera.protocol import ASSUMED, LEVELS
from maskfab.camera.scenes import bundled
from maskfab.camera.shots import Crop, Shot, shots, truth_of
from maskfab.camera.transfer import CELLS, FEWEST_CELLS, PITCH_UM, CellGrid, Laid
from maskfab.errors import JobError
from maskfab.files.release_memory import give_back
from maskfab.model import Camera, Die, Panel, Quantity, Tiling, refined
from maskfab.optimiser.model.expected_psnr import SceneStatistics, Surrogate
from maskfab.progress import Progress, silent
from maskfab.units import NM_PER_UM

SHOWN_LEVELS = (24, 40)
"""Levels at which photographs are taken, dB: little light and much."""
CROP = Crop(144, 192)
"""Part of the photographs that is shown."""

_SAME_UM = 1e-6

RESIDUAL_DB: Mapping[int, float] = MappingProxyType({24: 0.7, 32: 0.5, 40: 1.0})
"""Largest difference, by level, of the prediction from protocol F1 run on the four bundled scenes (mean of their PSNRs,
ε the best for all four): twelve dies, cells of 84, 92 and 168 um, repeated, turned at random, and by a designed map.
"""


OTHER_RESIDUAL_DB: Mapping[int, float] = MappingProxyType({24: 1.2, 32: 0.8, 40: 1.0})
"""Errors behind other cameras, on two of the scenes: five of f = 2 to 15 mm, stops of 1 to 4 mm and pixels of 1 to
3 um, four dies each, repeated and turned at random."""

_OTHER_CAMERA = "surrogate over the bundled scenes behind the job's camera, at the levels of light of protocol F1"
_OF_CAMERAS = ("MF133", "MF134", "MF135", "MF136")


@dataclass(frozen=True, eq=False)
class Restored:
    """Quality of the photographs behind one die.

    Attributes:
        quantities: ``restored_psnr`` at every level of light, or a note on why the camera allows none.
        scene: of the photographs; None if none were taken.
        truth: part of the scene, float32 [3, rows, columns], row 0 on top; None likewise.
        shots: the same part of every restored photograph, by rising level.
    """

    quantities: tuple[Quantity, ...]
    scene: str | None = None
    truth: NDArray[np.float32] | None = None
    shots: tuple[Shot, ...] = ()


def restore_photographs(
    dies: Sequence[Die], camera: Camera, designed: Collection[str], progress: Progress = silent
) -> dict[str, Restored]:
    """Restored photographs behind dies that can be judged so: expected PSNRs; taken through ``designed`` ones."""
    try:
        seen = PhotoCamera.of(camera)
    except JobError as refusal:
        return {die.name: not_judged(die, refusal) for die in dies}
    take = photographer(dies, camera=seen)
    if take is None:
        return {}
    found = dict(take.refused)
    judged = [die for die in dies if die.name in take.laid]
    for done, die in enumerate(judged):
        progress("photographs", done, len(judged))
        found[die.name] = take(die, photographs=die.name in designed)
        give_back()
    if judged:
        progress("photographs", len(judged), len(judged))
    return found


@dataclass(frozen=True, eq=False)
class Photographer:
    """Everything that does not depend on the die.

    Attributes:
        laid: every die that can be judged, as the camera sees it, by name.
        refused: of others, why the camera cannot judge them.
        scenes: photographs that are averaged over.
        estimates: surrogates by the cells behind the stop.
        camera: that looks through all dies.
    """

    laid: Mapping[str, Laid]
    refused: Mapping[str, Restored]
    scenes: tuple[Photograph, ...]
    estimates: Mapping[CellGrid, Surrogate]
    camera: PhotoCamera

    def __call__(self, die: Die, *, photographs: bool) -> Restored:
        """Predict the PSNR of one of ``laid``, and with ``photographs`` take some of the first scene through it."""
        quantities = tuple(self._predicted(die))
        if not photographs:
            return Restored(quantities)
        try:
            _ = self.camera.colours_nm
        except JobError as refusal:
            return Restored((*quantities, *not_judged(die, refusal).quantities))
        scene = self.scenes[0]
        taken = shots(self.laid[die.name], scene, SHOWN_LEVELS, CROP)
        return Restored(quantities, scene.name, truth_of(scene, CROP), taken)

    def _predicted(self, die: Die) -> list[Quantity]:
        panel, laid = die.panel, self.laid[die.name]
        estimate = self.estimates[laid.lattice]
        if not panel.others and panel.tiling in (Tiling.PERIODIC, Tiling.RANDOM):
            found = estimate(_unit(panel, laid), periodic=panel.tiling is Tiling.PERIODIC)
            how = "all random layouts" if panel.tiling is Tiling.RANDOM else "the repeated opening"
        elif self.camera.is_f1 and abs(laid.lattice.side * laid.lattice.dot_um - CELLS * PITCH_UM) > _SAME_UM:
            return []  # the error of one layout is only known of panels of the protocol's own side
        else:
            # It brings torch along, which takes longer to start than most plates take to check.
            from maskfab.optimiser.model.layout_error import pupil_error

            found = pupil_error(estimate).psnr(laid.pupil)
            how = "this very layout"
        told = "surrogate of protocol F1 over the bundled scenes" if self.camera.is_f1 else _OTHER_CAMERA
        against = "for twelve dies" if self.camera.is_f1 else "behind five cameras"
        residual = RESIDUAL_DB if self.camera.is_f1 else OTHER_RESIDUAL_DB
        return [
            Quantity(
                "restored_psnr",
                value,
                f"expected: {told}, for {how}; error: its largest difference from the protocol itself, run on these "
                f"scenes {against}; assumed: {ASSUMED}",
                uncertainty=residual[level],
                die=die.name,
                level_db=level,
            )
            for level, value in zip(LEVELS, found, strict=True)
        ]


def photographer(
    dies: Sequence[Die], scenes: Sequence[Photograph] | None = None, camera: PhotoCamera = F1
) -> Photographer | None:
    """Prepare for the dies that cover the camera's stop and that can be judged; None if there are none.

    Args:
        dies: of a plate.
        scenes: of 1024 x 1536 pixels; None for the bundled ones.
        camera: that looks through them.
    """
    laid: dict[str, Laid] = {}
    refused: dict[str, Restored] = {}
    for die in dies:
        if min(die.panel.size_nm) < camera.stop.diameter_um * NM_PER_UM:
            continue
        try:
            seen = laid_panel(die.name, die.panel, camera)
            _require_cells(die, seen.lattice)
            laid[die.name] = seen
        except JobError as refusal:
            if refusal.code in _OF_CAMERAS:
                refused[die.name] = not_judged(die, refusal)
    if not laid:
        return Photographer({}, refused, (), {}, camera) if refused else None
    known = tuple(scenes) if scenes is not None else bundled()
    statistics = SceneStatistics.of(known)
    estimates = {room: statistics.behind(room) for room in dict.fromkeys(each.lattice for each in laid.values())}
    return Photographer(laid, refused, known, estimates, camera)


def _require_cells(die: Die, room: CellGrid) -> None:
    """Refuse random layouts of too few cells for the mean over all layouts to represent them."""
    if die.panel.tiling is Tiling.RANDOM and room.cells < FEWEST_CELLS and not room.camera.is_f1:
        raise JobError(
            "MF136",
            f"the stop of {room.camera.stop.diameter_um:g} um has {room.cells} x {room.cells} cells of "
            f"{die.panel.cell_size.pitch_um:g} um behind it; a random layout of fewer than {FEWEST_CELLS} x "
            f"{FEWEST_CELLS} may lie 2 dB from the mean over all layouts",
            where=die.name,
            cure="Use another tiling, smaller cells or a larger stop",
        )


def not_judged(die: Die, why: JobError) -> Restored:
    """A note that photographs behind a die are not judged, or not taken."""
    told = "photographs behind this die are not judged, or not taken, for this reason"
    return Restored((Quantity("photographs_refused", f"{why.code} {why.what}", told, die=die.name),))


def _unit(panel: Panel, laid: Laid) -> NDArray[np.bool_]:
    """The opening on these dots, its gutter round it."""
    fine = refined(panel.opening.mask, panel.dot_nm // round(NM_PER_UM * laid.lattice.dot_um))
    return np.pad(fine, (laid.lattice.dots - len(fine)) // 2)
