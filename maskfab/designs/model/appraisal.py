"""Appraisal of a designed panel: in the conditions of its scene, and beside panels that are not quite the one designed.

A panel on a die has its map in the middle, and all beyond it as the map says or as its tiling draws it.

Conditions are what a job's [scene] has of distances and places, as far as its plan models it. A photograph is of one
distance, by the plan's ends of the depth and the focus between them, and shows the field. Means over it are those of
five points of a disc, exact up to third powers: its middle, by 1/4, and four at sqrt(2/3) of the largest image height
along the axes, by 3/16 each. The plan is that of a stand-in, the first shape of the search on a random tiling, for no
opening is known yet.

In each condition photographs are taken through the die's own transfer (:mod:`maskfab.camera.die_transfer`), as the plan
has it, with the gap's shift and diffraction, depth and aberrations; the middle line stands for all. As in photographs,
the camera knows the blur of the axis at the distance of what is photographed, and restores the whole picture by it.

Panels that are made have edges elsewhere, a stop off centre, or another seed. A bias b moves every edge by b / 2. Cut
into a core and strips of that width, a dot is clear or closed as a whole in each of its 3 x 3 parts, which repeat from
dot to dot. So at whole lags the biased panel's autocorrelation is exactly

    A(t) = sum over the parts of their area times the pairs of dots t apart in which both are clear,

and the surrogate asks for no others. Photographs are restored by the transfer of the panel as it is. Means over a
normal spread are those of its two points one standard deviation off, or of four for two directions, which are exact up
to third powers.

Notes:
    Corners stay sharp. Where clear dots only touch at a corner, a wider one joins them, a narrower one parts them.
    Where the stop lies beyond the map, cells are turned at random.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Labels, Mask, Singles
from maskfab.base.model import ORIENTATIONS, Opening, Panel, Tiling, orient, side_by_side
from maskfab.base.units import NM_PER_UM
from maskfab.camera.die_transfer import DieTransfer, by_plan, die_transfer
from maskfab.camera.stop_cells import CellGrid
from maskfab.job.camera import Camera
from maskfab.job.values import distance_text, um_text
from maskfab.mask.panels import CellMap, panel_shape, placed, shifted_openings
from maskfab.optics.gap import AXIS, Place, gap_guard_um, shift_um
from maskfab.optics.phase import image_distance_um
from maskfab.optics.scene.plan import Plan, phase_waves, plan
from maskfab.optics.scene.scene import Scene
from maskfab.optics.stop import Waves
from maskfab.optics.tiling import orientations

if TYPE_CHECKING:
    from maskfab.designs.model.panel_error import PupilError, Transfers


_WHERE = "design"

_FIELD = ((AXIS, 1 / 4), ((1.0, 0.0), 3 / 16), ((-1.0, 0.0), 3 / 16), ((0.0, 1.0), 3 / 16), ((0.0, -1.0), 3 / 16))

_AT = math.sqrt(2 / 3)

_SAMPLES = 4
"""For each dot, over whose finest waves a panel shows what comes through a gap."""

_NOT_OF_SCENE = ("curve of the rim", "the layout itself", "oblique light")

_MIDDLE = 1

TILINGS = 8
"""Random tilings whose PSNRs are compared: their standard deviation is known within a quarter."""

_OFF_CELLS = (1, 2)

_BIAS_UM = 0.1


def designed_panel(
    unit: Mask,
    dot_nm: int,
    *,
    tiling: Tiling,
    seed: int,
    across: int,
    given: CellMap | None = None,
    outer: Mask | None = None,
) -> Panel:
    """Lay an opening, or two, on a die.

    Args:
        unit: bool [dots, dots].
        tiling: of the cells; where there is a map, of what is meant by it.
        given: the map; None for a die of the tiling alone.
        outer: the sparser opening of two, bool [dots, dots].
    """
    openings = (Opening("unit", unit, dot_nm), *(() if outer is None else (Opening("outer", outer, dot_nm),)))
    if given is None:
        held = orientations(tiling, across, across, seed, openings=len(openings))
    else:
        openings = shifted_openings(given, openings, where=_WHERE)
        rows, columns = panel_shape(given, across, across)
        held = placed(given, rows, columns, seed, openings=len(openings), where=_WHERE)
    return Panel(openings[0], dot_nm, 0, held, tiling, seed, others=openings[1:])


def cells_across(camera: Camera, scene: Scene, room: CellGrid) -> int:
    """Cells along a panel that covers the stop from every place and a gap's spread; even or odd as ``room``'s are."""
    moved = max(shift_um(camera, scene.gap_um, (scene.widest_um, 0.0)))
    finest = room.dot_um / _SAMPLES
    spread = min(scene.gap_um, gap_guard_um(scene.gap_um, max(camera.wavelengths_nm), finest))
    return room.cells + 2 * math.ceil((moved + spread) / (room.dots * room.dot_um))


@dataclass(frozen=True)
class Condition:
    """One place of one photograph.

    Attributes:
        image_um: place on the sensor, from the axis to the right and down the picture.
        weight: its share of all; they sum to 1.
    """

    object_um: float
    image_um: Place
    weight: float


@dataclass(frozen=True, eq=False)
class SceneConditions:
    """A job's scene before its camera, and what of it must be modelled."""

    camera: Camera
    scene: Scene
    plan: Plan

    @classmethod
    def planned(cls, camera: Camera, scene: Scene, accuracy: float, shape: Mask, room: CellGrid) -> SceneConditions:
        """Conditions by the plan for a shape, bool [dots, dots], whose cells are turned at random.

        Raises:
            JobError: as :func:`maskfab.optics.scene.plan.plan`, and :func:`maskfab.camera.die_transfer.die_transfer`
                for all that is photographed; MF115 for a phase that turns too much over a dot.
        """
        across = cells_across(camera, scene, room)
        dot_nm = round(room.dot_um * NM_PER_UM)
        panel = designed_panel(shape, dot_nm, tiling=Tiling.RANDOM, seed=0, across=across)
        made = cls(camera, scene, plan(panel, camera, scene, accuracy))
        for distance in made.distances_um if made.needed else ():
            waves = made.waves(distance, room.camera.middle_nm)
            if waves is not None:
                made.behind(room).turned(waves)
            die = die_transfer("the design", panel, camera, scene, made.plan, object_um=distance)
            for place, _ in made.places:
                die.at(place)
        return made

    @property
    def needed(self) -> bool:
        """Whether the plan models anything that openings are compared by."""
        choice = self.plan.choice
        return choice.scale or choice.defocus or choice.aberrations or choice.diffraction or choice.places > 1

    @cached_property
    def distances_um(self) -> tuple[float, ...]:
        """Distances of objects in photographs, ascending."""
        near, far, focus = self.scene.nearest_um, self.scene.farthest_um, self.scene.focus_um
        if not self.plan.choice.defocus:
            return (focus,)
        return tuple(sorted({near, far, *([focus] if near < focus < far else [])}))

    @cached_property
    def places(self) -> tuple[tuple[Place, float], ...]:
        """Places of a photograph, each with its share; the axis first."""
        if self.plan.choice.places == 1:
            return ((AXIS, 1.0),)
        reach = _AT * self.scene.widest_um
        return tuple(((reach * x, reach * y), share) for (x, y), share in _FIELD)

    def __iter__(self) -> Iterator[Condition]:
        """Conditions, distance by distance."""
        for distance in self.distances_um:
            for place, share in self.places:
                yield Condition(distance, place, share / len(self.distances_um))

    @property
    def turns_light(self) -> bool:
        """Whether light at the axis has a phase, or a scale, of its own at any distance: a gap alone gives none."""
        choice = self.plan.choice
        return choice.scale or choice.defocus or choice.aberrations

    def waves(self, object_um: float, wavelength_nm: float) -> Waves | None:
        """Phase of light from a distance at the stop; None for none."""
        return phase_waves(self.plan.choice, self.camera, self.scene, wavelength_nm, object_um)

    def behind(self, room: CellGrid) -> CellGrid:
        """The cells before the camera as it is focused."""
        if not self.plan.choice.scale:
            return room
        distance = image_distance_um(self.camera.focal_um, self.scene.focus_um)
        return replace(room, camera=replace(room.camera, focal_um=distance))

    @property
    def modelled(self) -> tuple[str, ...]:
        """Names of what the plan models of the scene."""
        rows = self.plan.ingredients
        return tuple(row.name for row in rows if row.modelled and row.error and row.name not in _NOT_OF_SCENE)

    @property
    def line(self) -> str:
        """In words, exactly: the stated lengths, and what is modelled."""
        scene, parts = self.scene, []
        if self.plan.choice.defocus or self.plan.choice.scale:
            ends = scene.nearest_um, scene.farthest_um, scene.focus_um
            near, far, focus = (distance_text(distance) for distance in ends)
            parts.append(f"depth {near} to {far}, focus {focus}")
        if scene.gap_um:
            parts.append(f"gap {um_text(scene.gap_um)}")
        if scene.gap_um and scene.field_um:
            parts.append(f"field {um_text(scene.field_um)}")
        if self.plan.choice.aberrations:
            parts.append(f"aberrations {', '.join(f'{waves:g} of {term}' for term, waves in scene.aberrations)}")
        return f"{'; '.join(parts)}; modelled: {', '.join(self.modelled)}"

    @property
    def neglected(self) -> tuple[str, ...]:
        """Sentences on what the plan leaves out of the scene."""
        return tuple(by_plan(self.scene, self.plan))


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
        errors: for each distance, that of panels in its light, or one for all; scenes and noise are taken from it.

    Raises:
        JobError: as :func:`maskfab.camera.die_transfer.die_transfer`.
    """
    by_distance = tuple(errors) if len(errors) > 1 else tuple(errors) * len(seen.distances_um)
    places, shares = zip(*seen.places, strict=True)
    psnr: list[tuple[float, ...]] = []
    means = []
    for distance, error in zip(seen.distances_um, by_distance, strict=True):
        die = die_transfer("the design", panel, seen.camera, seen.scene, seen.plan, object_um=distance)
        lines, samples = die.lines[_MIDDLE], die.samples
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
            tuple(error.decibels(level, place[k, best[k]]) for k, level in enumerate(error.levels))
            for place in by_place
        ]
    return SceneAppraisal(tuple(seen), tuple(psnr), tuple(np.mean(means, axis=0).tolist()))


def transfers(die: DieTransfer, error: PupilError) -> Transfers:
    """H of the middle line at the frequencies that an error is summed over."""
    lines, samples = die.lines[_MIDDLE], die.samples
    square, low = (die.view.transfer(lines, samples, y, x) for y, x in error.frequencies)
    return square, low


@dataclass(frozen=True)
class Spread:
    """Standard deviations over the panels made: width of clear features; the stop's centre from the map's, by axis."""

    bias_um: float = 0.0
    centre_um: float = 0.0


EXACT = Spread()
"""Panels as they are designed."""


@dataclass(frozen=True)
class Varied:
    """PSNR where something is off by one standard deviation, by level, dB.

    Attributes:
        psnr: at each of its points; of a bias, narrower and wider.
        loss: the panel's own PSNR less the mean over the spread; negative where it gains.
    """

    deviation_um: float
    psnr: tuple[tuple[float, ...], ...]
    loss: tuple[float, ...]


@dataclass(frozen=True)
class Robustness:
    """A panel's PSNR beside that of others like it, by level, dB.

    Attributes:
        psnr: of the panel; of a random tiling, that of the seed.
        tiling: standard deviation over random tilings of the opening; None for cells that are all alike, and where
            they hold several openings, or one at several places.
        off_centre: by how far the stop's centre lies off, um, the map's gain over the mean of random tilings, mean of
            four directions; from 0 on; empty without a map, and where ``tiling`` is None.
        bias, centre: over the spread; None where none is stated.
    """

    psnr: tuple[float, ...]
    tiling: tuple[float, ...] | None
    off_centre: dict[float, tuple[float, ...]]
    bias: Varied | None
    centre: Varied | None


def robustness(
    units: Mask, kinds: Labels, error: PupilError, *, spread: Spread, seed: int, periodic: bool, mapped: bool
) -> Robustness:
    """Appraise a panel.

    Args:
        units: bool [units, dots, dots].
        kinds: of the cells before the stop, 8 u + k for unit u under element k of D4, [cells, cells].
        periodic: every cell has the unit as it is.
    """
    dots, pitch_um = error.dots, error.dots * error.lattice.dot_um
    draw = np.random.default_rng([seed, 2])
    off = [count * dots for count in _OFF_CELLS] if mapped and len(units) == 1 else []
    away = round(spread.centre_um / pitch_um * dots)
    pad = math.ceil(max([*off, away]) / dots)
    around = draw.integers(1 if periodic else ORIENTATIONS, size=tuple(side + 2 * pad for side in kinds.shape))
    around[pad : pad + len(kinds), pad : pad + len(kinds)] = kinds
    picture = laid_picture(units, around)

    def seen(y: int, x: int) -> Mask:
        side, start = error.inside.shape[0], pad * dots
        return picture[start + y : start + y + side, start + x : start + x + side]

    here = seen(0, 0)
    own = _psnr(error, here)
    tiling, off_centre = None, {}
    if not periodic and len(units) == 1:
        # Layouts of one opening differ by fewer lags as they do by all.
        steps = error.of_steps
        others = [
            _psnr(steps, laid_picture(units, draw.integers(ORIENTATIONS, size=kinds.shape))) for _ in range(TILINGS)
        ]
        tiling = tuple(np.std(others, axis=0, ddof=1).tolist())
        for step in (0, *off) if mapped else ():
            places = sorted({(step, 0), (-step, 0), (0, step), (0, -step)})
            gains = np.mean([_psnr(steps, seen(*place)) for place in places], axis=0) - np.mean(others, axis=0)
            off_centre[step / dots * pitch_um] = tuple(gains.tolist())
    bias = centre = None
    if spread.bias_um:
        bias = _varied(spread.bias_um, own, [_psnr(error, here, sign * spread.bias_um) for sign in (-1, 1)])
    if spread.centre_um:
        corners = product((-away, away), repeat=2)
        centre = _varied(away / dots * pitch_um, own, [_psnr(error, seen(*corner)) for corner in corners])
    return Robustness(own, tiling, off_centre, bias, centre)


def _varied(deviation_um: float, own: Sequence[float], points: list[tuple[float, ...]]) -> Varied:
    return Varied(deviation_um, tuple(points), tuple((np.array(own) - np.mean(points, axis=0)).tolist()))


def compared_bias_um(dot_nm: int) -> float:
    """Bias by which openings of such dots are compared: as a mask shop keeps it, and a quarter of a dot at most."""
    return min(_BIAS_UM, dot_nm / NM_PER_UM / 4)


def moved_by_bias(unit: Mask, kinds: Labels, error: PupilError, bias_um: float) -> float:
    """Decibels, weighted mean over the levels, by which a bias to either side moves the PSNR of a panel.

    Args:
        unit: bool [dots, dots].
        kinds: elements of D4 of the cells before the stop, [cells, cells].
    """
    picture = laid_picture(unit[None], kinds)
    narrow, wide = (np.dot(error.weights, _psnr(error, picture, sign * bias_um)) for sign in (-1, 1))
    return float(abs(wide - narrow) / 2)


def _psnr(error: PupilError, picture: Mask, bias_um: float = 0.0) -> tuple[float, ...]:
    return error.psnr_of_table(biased_table(error, picture, bias_um))


def biased_table(error: PupilError, picture: Mask, bias_um: float) -> Singles:
    """Autocorrelation, as :meth:`PupilError.table` has it, of a panel whose clear features are wider by the bias.

    Args:
        error: of panels of such dots.
        picture: bool [side, side] of the dots, those beyond the stop included.
        bias_um: less than a dot; negative narrows.
    """
    if bias_um == 0:
        return error.table(picture & error.inside)
    strip = abs(bias_um) / 2 / error.lattice.dot_um
    share = {-1: strip, 0: 1 - 2 * strip, 1: strip}
    grown = picture if bias_um > 0 else ~picture
    around = np.pad(grown, 1, mode="edge")
    places = list(product(share, repeat=2))

    def part(down: int, left: int) -> Mask:
        # A strip is taken over by what lies beside it.
        rows = around[1 : 1 + len(grown)] | around[1 - down : 1 - down + len(grown)]
        taken = rows[:, 1:-1] | rows[:, 1 - left : 1 - left + grown.shape[1]]
        return np.asarray((taken if bias_um > 0 else ~taken) & error.inside)

    return error.mean_table((part(*place) for place in places), [share[down] * share[left] for down, left in places])


def laid_picture(units: Mask, kinds: NDArray[np.integer]) -> Mask:
    """Dots of a panel, bool [rows dots, columns dots], of units [units, dots, dots] and kinds [rows, columns], 8 u + k
    for unit u under element k of D4."""
    patterns = np.stack([orient(unit, k) for unit in units for k in range(ORIENTATIONS)])
    return np.asarray(side_by_side(patterns[kinds]))
