"""Prices of what a die is not as drawn, in decibels of restored photographs.

Each disagreement is priced alone and all together. Photographs of drawn scenes are taken through the die as it was
fitted and restored by the Wiener filter, once by the PSF of the die as drawn and once by its own; the difference is
what nobody loses who restores by the fitted PSF. What is left against a die as drawn, restored by its own, is lost for
good (or won: a wider opening has more light).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.camera.blur import MeasuredBlur
from maskfab.camera.imaging import Isoplanatic, RestoredBy, Transfer
from maskfab.camera.inspection.die_image import BIAS, DieImage, Pixels, Setting
from maskfab.camera.protocol import STRENGTHS, Protocol, evaluate
from maskfab.camera.scenes import NARROW, SMALLEST, Photograph, dead_leaves
from maskfab.camera.scores import MeanDifference, Score
from maskfab.camera.sensor import Exposure
from maskfab.job.camera import Sensor
from maskfab.optics.phase import NOLL
from maskfab.optics.spectrum import line_spectrum

LEVEL_DB = 40.0
"""Signal-to-noise ratio of white behind the published display, where a full well allows it."""
COST_METHOD = (
    "photographs of 4 drawn scenes in linear light, white at 40 dB behind the published display or as near as a full "
    "well allows, through the die with this alone beside the drawn, in one line of light for each colour, restored by "
    "the Wiener filter at the strength that is best for the die as drawn; PSNR without 64 pixels at each edge; error: "
    "half the 95 % interval of the mean over the scenes by Student's t; not in it: the errors of what was fitted"
)
ALL, ORIENTATION = "all together", "way round"
_SIDE = 2 * NARROW + 1
_SCENES = (1, 2, 3, 4)
_COLOURS = 3
_FULL = 0.99


@dataclass(frozen=True)
class Cost:
    """Price of one disagreement, in dB of restored photographs.

    Attributes:
        of: the disagreement: a name of :attr:`Setting.names`, :data:`ORIENTATION` or :data:`ALL`.
        by_design: lost by restoring as drawn what was taken through the die as it is, against restoring it by its own.
        for_good: lost although it is restored by its own, against a die as drawn that is restored as drawn.
    """

    of: str
    by_design: MeanDifference
    for_good: MeanDifference


@dataclass(frozen=True, eq=False)
class _Seen(Isoplanatic):
    """A die of one setting, as photographs are taken through it."""

    blur: MeasuredBlur
    share: float

    @property
    def transmission(self) -> float:
        return self.share

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        return self.blur.on(shape)


def costs(image: DieImage, setting: Setting, seen: Sequence[str], drawn_way_round: int, sensor: Sensor) -> list[Cost]:
    """Costs of every disagreement between a die as fitted and as drawn, and of all together.

    Args:
        seen: names of the setting's values that are above their errors; place and those below cost nothing alone.
        drawn_way_round: element of D4 by which the die would stand if it were as the job says.
    """
    centred = replace(setting, x_um=0.0, y_um=0.0)
    alone = [(name, _only(centred, name), drawn_way_round) for name in seen if not name.endswith("_um") or name == BIAS]
    if image.way_round != drawn_way_round:
        alone.append((ORIENTATION, Setting(), image.way_round))
    parts = [*alone, (ALL, centred, image.way_round)]
    # The die, one way round or another, in one line of light for each colour.
    axis = image.camera.pixel_um * (np.arange(_SIDE, dtype=np.float64) - _SIDE // 2)
    light = {
        colour: line_spectrum([float(lines.weights @ lines.wavelengths_nm)]) for colour, lines in image.light.items()
    }
    pixels = tuple(Pixels(colour, axis, -axis) for colour in light)
    ways = {image.way_round, drawn_way_round}
    standing = {way: DieImage.of(image.panel, way, image.camera, light, pixels) for way in ways}

    def window_light(pictures: Sequence[Floats]) -> float:
        return float(np.mean([picture.sum() for picture in pictures]))

    window_share = window_light(standing[image.way_round].pictures(Setting()))

    def standing_at(name: str, way_round: int, setting: Setting) -> _Seen:
        pictures = standing[way_round].pictures(setting)
        # Pictures are in units of the light of a die as drawn; a wider one has more.
        share = min(1.0, standing[way_round].transmission * window_light(pictures) / window_share)
        kernels = np.stack([picture / picture.sum() for picture in pictures])
        whole = np.broadcast_to(kernels, (_COLOURS, _SIDE, _SIDE)) if len(kernels) == 1 else kernels
        middle = float(_SIDE // 2)
        return _Seen(name, MeasuredBlur(whole, (middle, middle), ()), share)

    level_db = min(LEVEL_DB, Exposure.of_white(_FULL * sensor.ceiling, sensor).level_db)

    def scores(die: _Seen, restored_by: _Seen, strengths: Sequence[tuple[float, ...]]) -> list[Score]:
        """Score of every scene, restored by the blur of another die at the best of some strengths."""
        design, results = RestoredBy(die, restored_by), list[Score]()
        for scene, epsilons in zip(_scenes(), strengths, strict=True):
            protocol = Protocol("camera", sensor, strengths=epsilons)
            results += evaluate([design], [scene], [scene], [level_db], protocol=protocol, details=False).scores
        return results

    def lost(before: Sequence[Score], after: Sequence[Score]) -> MeanDifference:
        pairs = zip(before, after, strict=True)
        return MeanDifference.of([one.psnr_inner - other.psnr_inner for one, other in pairs])

    drawn = standing_at("drawn", drawn_way_round, Setting())
    right = scores(drawn, drawn, [STRENGTHS] * len(_scenes()))
    best = [(score.epsilon,) for score in right]
    prices = []
    for name, at, way in parts:
        die = standing_at(name, way, at)
        own = scores(die, die, best)
        prices.append(Cost(name, lost(own, scores(die, drawn, best)), lost(right, own)))
    return prices


def _only(setting: Setting, name: str) -> Setting:
    terms = tuple(term for term in setting.terms if f"z{term[0]}" == name)
    return Setting(terms=terms) if terms else replace(Setting(), **{name: getattr(setting, name)})


@cache
def _scenes() -> tuple[Photograph, ...]:
    """Scenes in full light, of the least size: those indoors lose less, for they have less to lose."""
    return tuple(replace(dead_leaves(number, SMALLEST, SMALLEST), around=NARROW) for number in _SCENES)


TERM_NAMES = {number: name.replace("_", " ") for name, number in NOLL.items()}
_NAMES = {BIAS: "CD bias", "scale": "scale", "turn_rad": "turn"}


def disagreement(name: str) -> str:
    """A disagreement in words."""
    if name in _NAMES or not name.startswith("z"):
        return _NAMES.get(name, name)
    return TERM_NAMES.get(int(name[1:]), f"Zernike {name[1:]}")
