"""Price, in restored photographs, of a die that is not as it was designed: of each disagreement alone, and of all.

Photographs of drawn scenes are taken through the die as it was fitted and restored by the Wiener filter, once by the
PSF of the die as drawn and once by its own; the difference is what nobody loses who restores by the fitted PSF. What
is left against a die as drawn, restored by its own, is lost for good (or won: a wider opening has more light).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.camera.design import Isoplanatic, RestoredBy
from maskfab.camera.exposure import Exposure
from maskfab.camera.intervals import MeanDifference
from maskfab.camera.photographs import NARROW, SMALLEST, Photograph
from maskfab.camera.protocol import STRENGTHS, Protocol, evaluate
from maskfab.camera.restorers.restorer import Transfer
from maskfab.camera.scenes import dead_leaves
from maskfab.camera.scores import Score
from maskfab.camera.sensor import Sensor
from maskfab.capture.die_image import BIAS, DieImage, Pixels, Setting
from maskfab.capture.restoring.measured_psf import MeasuredBlur
from maskfab.optics.image.spectrum import line_spectrum

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
        """See :class:`maskfab.camera.design.Design`."""
        return self.share

    def _transfer(self, shape: tuple[int, int]) -> Transfer:
        return self.blur.on(shape)


@dataclass(frozen=True, eq=False)
class _Dies:
    """The die, one way round or another, in one line of light for each colour.

    Attributes:
        standing: images of it, by way round.
        window_share: of the light of a die as drawn that their pictures hold.
    """

    standing: dict[int, DieImage]
    window_share: float

    @classmethod
    def of(cls, image: DieImage, ways_round: Collection[int]) -> _Dies:
        axis = image.camera.pixel_um * (np.arange(_SIDE, dtype=np.float64) - _SIDE // 2)
        light = {
            colour: line_spectrum([float(lines.weights @ lines.wavelengths_nm)])
            for colour, lines in image.light.items()
        }
        pixels = tuple(Pixels(colour, axis, -axis) for colour in light)
        standing = {way: DieImage.of(image.panel, way, image.camera, light, pixels) for way in ways_round}
        return cls(standing, _held(standing[image.way_round].pictures(Setting())))

    def seen(self, name: str, way_round: int, setting: Setting) -> _Seen:
        image = self.standing[way_round]
        pictures = image.pictures(setting)
        # Pictures are in units of the light of a die as drawn; a wider one has more.
        share = min(1.0, image.transmission * _held(pictures) / self.window_share)
        kernels = np.stack([picture / picture.sum() for picture in pictures])
        whole = np.broadcast_to(kernels, (_COLOURS, _SIDE, _SIDE)) if len(kernels) == 1 else kernels
        middle = float(_SIDE // 2)
        return _Seen(name, MeasuredBlur(whole, (middle, middle), ()), share)


def _held(pictures: Sequence[Floats]) -> float:
    return float(np.mean([picture.sum() for picture in pictures]))


def costs(image: DieImage, setting: Setting, seen: Sequence[str], drawn_way_round: int, sensor: Sensor) -> list[Cost]:
    """Costs of every disagreement between a die as fitted and as drawn, and of all together.

    Args:
        image: of the die, the way round that it stands.
        setting: that was fitted.
        seen: names of the setting's values that are above their errors; place and those below cost nothing alone.
        drawn_way_round: element of D4 by which the die would stand if it were as the job says.
        sensor: that takes the photographs.
    """
    centred = replace(setting, x_um=0.0, y_um=0.0)
    alone = [(name, _only(centred, name), drawn_way_round) for name in seen if not name.endswith("_um") or name == BIAS]
    if image.way_round != drawn_way_round:
        alone.append((ORIENTATION, Setting(), image.way_round))
    parts = [*alone, (ALL, centred, image.way_round)]
    dies = _Dies.of(image, {image.way_round, drawn_way_round})
    drawn = dies.seen("drawn", drawn_way_round, Setting())
    right = [_score(sensor, scene, drawn, drawn, STRENGTHS) for scene in _scenes()]

    def psnr(seen: _Seen, known: _Seen) -> list[float]:
        pairs = zip(_scenes(), right, strict=True)
        return [_score(sensor, scene, seen, known, (best.epsilon,)).psnr_inner for scene, best in pairs]

    found = []
    for name, at, way in parts:
        die = dies.seen(name, way, at)
        own, by_design = psnr(die, die), psnr(die, drawn)
        found.append(Cost(name, _lost(own, by_design), _lost([best.psnr_inner for best in right], own)))
    return found


def _only(setting: Setting, name: str) -> Setting:
    """A die as drawn but for one value of a setting."""
    terms = tuple(each for each in setting.terms if f"z{each[0]}" == name)
    return Setting(terms=terms) if terms else replace(Setting(), **{name: getattr(setting, name)})


def _score(sensor: Sensor, scene: Photograph, seen: _Seen, known: _Seen, strengths: tuple[float, ...]) -> Score:
    """Of one scene through one die, restored by the blur of another at the best of some strengths."""
    protocol = Protocol("camera", sensor, strengths=strengths)
    table = evaluate([RestoredBy(seen, known)], [scene], [scene], [_level_db(sensor)], protocol=protocol, details=False)
    return table.scores[0]


def _lost(before: Sequence[float], after: Sequence[float]) -> MeanDifference:
    return MeanDifference.of([one - other for one, other in zip(before, after, strict=True)])


def _level_db(sensor: Sensor) -> float:
    return min(LEVEL_DB, Exposure.of_white(_FULL * sensor.full_well, sensor).level_db)


@cache
def _scenes() -> tuple[Photograph, ...]:
    """Scenes in full light, of the least size: those indoors lose less, for they have less to lose."""
    return tuple(replace(dead_leaves(number, SMALLEST, SMALLEST), around=NARROW) for number in _SCENES)
