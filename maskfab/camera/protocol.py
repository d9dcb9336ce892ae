"""Protocols: photographs behind designs, taken and scored so that designs compare fairly; the first of them is F1.

Every design sees the same scenes with light from outside the sensor, in real colours and noise for the light it lets
through, and is restored by the same filter, whose one constant ε is chosen for the design and the level on scenes kept
for that. Gains are paired, scene by scene.

Protocol F1 is one camera and one sensor, and takes code values for light. Protocol ``camera`` is the job's own: light
is linear, and a restored picture is coded again before it is scored. Protocol ``paper`` is the published evaluation, by
F1's camera and sensor: no light from outside the sensor, one fixed restoration, and pictures scored at the brightness
that the design leaves them (Yang, Sankaranarayanan 2021, section 5).

Notes:
    Much of a difference between designs is made at the picture's edge, by halo that crosses it. Quote the inner frame,
    64 pixels trimmed, next to the whole one.
    ε is found by climbing on its grid from an estimate by Parseval's theorem: the best of all 15 if the mean PSNR has
    one peak.
    Under protocol ``paper`` errors count as bright as the design leaves them, so twice the light costs 6 dB, and edges
    beside darkness cost well-conditioned designs more than others. Its PSNRs compare with published ones; they do not
    rank designs of unequal light.

Sensor and light that a job states, for all that takes its photographs or expects what they will be.

Sentences on all of a job that does not reach its photographs, and why.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.base.errors import JobError
from maskfab.base.model import Camera, MaskBlank, Panel
from maskfab.base.units import UM_PER_MM
from maskfab.camera.imaging import Design, SceneLight
from maskfab.camera.record import Record, Restorer, merged
from maskfab.camera.restorers.choice import Choice
from maskfab.camera.restorers.dct import EPSILON, Published
from maskfab.camera.restorers.wiener import Margin, Wiener, prior, spectral_error
from maskfab.camera.scenes import Photograph
from maskfab.camera.scores import Score, ScoreTable, Truth, inner, psnr
from maskfab.camera.sensor import F1_SENSOR, REFERENCE_TRANSMISSION, Exposure, Sensor
from maskfab.job.sections import ExposureSection, SensorSection
from maskfab.optics.colour import code_of_light, light_of_code
from maskfab.optics.scene.plan import Plan
from maskfab.optics.scene.scene import Scene

EPSILONS = tuple(float(e) for e in np.geomspace(0.002, 0.5, 15))
_FINER = EPSILONS[1] / EPSILONS[0]
STRENGTHS = (
    *(EPSILONS[0] / _FINER**k for k in range(12, 0, -1)),
    *EPSILONS,
    *(EPSILONS[-1] * _FINER**k for k in range(1, 11)),
)
"""The grid of ε, as far below it as linear light in little noise, or a record without noise, asks for, and as far above
it as a hundred electrons of white do."""
TRIM = 64
"""Pixels left out at each edge of the inner frame."""
LEVELS = (24, 32, 40)
ASSUMED = "an opaque film and no glass, whatever the job says of its plate"
"""Assumptions of protocol F1."""
WIENER = (Wiener(),)
AUTO = "auto"
"""Restorer of a score whose photograph was restored by the one that its record alone speaks for."""
_GREEN = slice(1, 2)


@dataclass(frozen=True)
class Protocol:
    """A way to take photographs and to score them.

    Attributes:
        name: in tables.
        sensor: that records them.
        linear: scenes are linear light, and restored pictures are coded again before they are scored; otherwise code
            values are taken for light, as much of the literature does.
        whole: electrons of white behind the published display are rounded.
        strengths: grid of ε, ascending.
        dark: nothing outside the sensor gives light.
        dimmed: pictures are scored as bright as the design leaves them, relative to the published display.
        restorers: that belong to it; none where any may be asked for.
        brackets: exposures that are taken of every scene and merged, as the times by which their light is less than
            the level's; of scenes with highlights. Empty for one exposure, of any scene.
        smooth: electrons are counted by normal distributions, see :meth:`maskfab.camera.sensor.Sensor.record`: for
            designs that differ by less than Poisson's draws do.

    Raises:
        JobError: MF143 for brackets that are below 1, not finite, alike, or of code values.
    """

    name: str
    sensor: Sensor = F1_SENSOR
    linear: bool = True
    whole: bool = False
    strengths: tuple[float, ...] = STRENGTHS
    dark: bool = False
    dimmed: bool = False
    restorers: tuple[Restorer, ...] = ()
    brackets: tuple[float, ...] = ()
    smooth: bool = False

    def __post_init__(self) -> None:
        possible = all(math.isfinite(cut) and cut >= 1 for cut in self.brackets)
        if not possible or len(set(self.brackets)) < len(self.brackets):
            cuts = ", ".join(f"{cut:g}" for cut in self.brackets)
            raise JobError(
                "MF143",
                f"brackets of {cuts} times less light than the level's; each must be 1 or more, and another",
                where="brackets",
                cure="Give numbers such as 1, 4 and 16",
            )
        if self.brackets and not self.linear:
            raise JobError(
                "MF143",
                "brackets are of light, and this protocol takes code values for it",
                where="brackets",
                cure="Use protocol camera with linear light, or remove the brackets",
            )

    def exposure(self, level_db: float) -> Exposure:
        """Light of a level.

        Raises:
            JobError: MF141 for no light, or for more than a full well.
        """
        return Exposure.at(level_db, self.sensor, whole=self.whole)

    def seen(self, design: Design, known: SensorScene) -> Singles:
        """Light of one scene on the sensor behind one design, white is 1 before it, [3, rows, columns]."""
        return design.blurred(known.light(linear=self.linear))

    def record(self, seen: Singles, design: Design, known: SensorScene, level_db: float) -> Record:
        """Light as ``seen``, in noise of its own: the same for every design at a level."""
        light, taken = self.exposure(level_db), []
        for cut in self.brackets or (1.0,):
            seed = 1000 * known.scene.number + round(light.electrons / cut)
            electrons = light.behind(design.transmission) / cut
            taken.append(self.sensor.record(seen, electrons, seed, smooth=self.smooth))
        return taken[0] if len(taken) == 1 else merged(taken)

    def photograph(self, design: Design, known: SensorScene, level_db: float) -> Record:
        """One scene through one design at one level of light."""
        return self.record(self.seen(design, known), design, known, level_db)

    def check(self, scene: Photograph) -> None:
        """Refuse brackets of a scene that has no light above white.

        Raises:
            JobError: MF143.
        """
        if not self.brackets or (scene.measured is not None and scene.measured.max() > 1):
            return
        reason = "code values, which end at white" if scene.measured is None else "no light above white"
        raise JobError(
            "MF143",
            f"brackets are for highlights, and this scene has {reason}",
            where=scene.name,
            cure="Give EXR or HDR photographs and the light in them that is white, or remove the brackets",
        )

    def shown(self, light: Singles) -> Singles:
        """Code values of a restored picture."""
        return code_of_light(light) if self.linear else light

    def brightness(self, design: Design) -> float:
        """Factor that scored pictures of a design are multiplied by."""
        return design.transmission / REFERENCE_TRANSMISSION if self.dimmed else 1.0


F1 = Protocol("f1", linear=False, whole=True, strengths=EPSILONS)
PAPER = Protocol(
    "paper", linear=False, whole=True, strengths=(EPSILON,), dark=True, dimmed=True, restorers=(Published(),)
)
"""The published evaluation."""


@dataclass(frozen=True, eq=False)
class SensorScene:
    """A scene, and its part on the sensor."""

    scene: Photograph
    margin: Margin
    true: Singles

    @classmethod
    def of(cls, scene: Photograph, *, dark: bool = False) -> SensorScene:
        """The sensor lies in the middle; of a ``dark`` one nothing outside it gives light."""
        margin = scene.margin
        true = margin.sensor(scene.values)
        return cls(replace(scene, values=margin.dark(true), measured=None) if dark else scene, margin, true)

    def light(self, *, linear: bool) -> SceneLight:
        """Of the scene; its code values taken for light where it is not ``linear``."""
        return SceneLight(self.scene.light if linear else self.scene.values, self.margin)

    def green(self, *, linear: bool) -> NDArray[np.complex64]:
        """Spectrum of the green that truly fell on the sensor, [1, rows, half], mirrored beyond its edges."""
        measured = self.scene.measured if linear else None
        green = self.margin.sensor((self.scene.values if measured is None else measured)[_GREEN])
        return self.margin.mirrored(light_of_code(green) if linear and measured is None else green)


def evaluate(
    designs: Sequence[Design],
    test: Sequence[Photograph],
    tuning: Sequence[Photograph],
    levels: Sequence[float] = LEVELS,
    *,
    protocol: Protocol = F1,
    restorers: Sequence[Restorer] = WIENER,
    choose: bool = False,
    details: bool = True,
    colours: bool = True,
    show: Callable[[Score, Singles], None] | None = None,
) -> ScoreTable:
    """Score every design on every test scene at every level, restored in every way.

    Args:
        designs: with names of their own.
        test: scenes to score on.
        tuning: scenes to choose ε on; they may be test scenes, though that flatters by a few hundredths of a decibel.
        levels: signal-to-noise ratios of white behind the published display, dB.
        protocol: how photographs are taken.
        restorers: of names of their own.
        choose: score the one that each photograph's record speaks for too, as :data:`AUTO`.
        details: score SSIM and S-CIELAB too, which takes half of the time.
        colours: of these, S-CIELAB.
        show: given every score with its restored picture, float32 [3, rows, columns] of the sensor, row 0 on top.

    Raises:
        JobError: MF105 without designs, levels, scenes or restorers, or for two of one name; MF104 for a closed design;
            MF141 for a level without light, or above a full well; MF134 behind a camera of other than three
            wavelengths; MF143 for brackets of a scene that has no light above white.
    """
    for what, names in (
        ("designs", [d.name for d in designs]),
        ("test scenes", [s.name for s in test]),
        ("tuning scenes", [s.name for s in tuning]),
        ("levels", [f"{level:g}" for level in levels]),
        ("restorers", [r.name for r in restorers]),
    ):
        if not names or len(set(names)) < len(names):
            problem = "some have one name" if names else "there are none"
            raise JobError("MF105", f"{what}: {problem}", where=what, cure="Give each once, with a name of its own")
    for level in levels:
        protocol.exposure(level)
    for scene in (*test, *tuning):
        protocol.check(scene)
    for design in designs:
        _require_light(design)
    prepared = {id(s): SensorScene.of(s, dark=protocol.dark) for s in (*tuning, *test)}
    likenesses: dict[float, dict[int, Truth]] = {}
    scores: list[Score] = []
    for design in designs:
        bright = protocol.brightness(design)
        if details and bright not in likenesses:
            likenesses = {bright: {id(s): Truth(_times(bright, prepared[id(s)].true)) for s in test}}
        seen = {key: protocol.seen(design, known) for key, known in prepared.items() if not known.margin.large}
        for level in sorted(levels):
            records = {key: protocol.record(light, design, prepared[key], level) for key, light in seen.items()}
            case = _Case(protocol, design, level, prepared, records, likenesses.get(bright, {}), colours)
            for found, picture in case.scored(test, tuning, restorers, choose=choose):
                scores.append(found)
                if show is not None:
                    show(found, picture)
    return ScoreTable(tuple(scores))


@dataclass(frozen=True, eq=False)
class _Case:
    """One design at one level of light; scenes by their ``id``.

    Attributes:
        protocol, design, level_db: of the case.
        scenes: all of them.
        records: of scenes that are not large; those of others are made again for each that restores them.
        likenesses: of test scenes, empty where nobody asked for details.
        colours: whether S-CIELAB is scored of them.
    """

    protocol: Protocol
    design: Design
    level_db: float
    scenes: Mapping[int, SensorScene]
    records: Mapping[int, Record]
    likenesses: Mapping[int, Truth]
    colours: bool

    def scored(
        self, test: Sequence[Photograph], tuning: Sequence[Photograph], restorers: Sequence[Restorer], *, choose: bool
    ) -> Iterator[tuple[Score, Singles]]:
        """Scores and pictures of every restorer with its best ε, and of the one chosen for each scene."""
        start = self._estimated(tuning) if len(self.protocol.strengths) > 1 else 0
        epsilons = dict[str, float]()
        for restorer in restorers:
            place, pictures = self._best(restorer, tuning, start)
            epsilon = epsilons[restorer.name] = self.protocol.strengths[place]
            for key in map(id, test):
                picture = pictures.get(key)
                if picture is None:
                    picture = self._restored(restorer, key)(epsilon)
                yield self._score(key, picture, epsilon, restorer.name), picture
        for key in map(id, test) if choose else ():
            won = Choice(restorers, coded=self.protocol.linear).restore(self._record(key), self.design, epsilons)
            picture = self.protocol.shown(won.picture)
            yield self._score(key, picture, won.epsilon, AUTO, won.name), picture

    def _record(self, key: int) -> Record:
        known = self.records.get(key)
        return self.protocol.photograph(self.design, self.scenes[key], self.level_db) if known is None else known

    def _restored(self, restorer: Restorer, key: int) -> Callable[[float], Singles]:
        """Code values of a scene restored, as a function of ε."""
        prepared = restorer.prepare(self._record(key), self.design)
        return lambda epsilon: self.protocol.shown(prepared(epsilon))

    def _estimated(self, tuning: Sequence[Photograph]) -> int:
        """Place of the ε that is best for green light behind the Wiener filter, its mirrored margin included,
        unclipped."""
        seen = []
        for key in map(id, tuning):
            known, margin = self.scenes[key], self.scenes[key].margin
            record, green = margin.mirrored(self._record(key).values[_GREEN]), known.green(linear=self.protocol.linear)
            seen.append((record, green, self.design.on(margin.shape)[_GREEN], prior(margin.shape)))

        def estimate(k: int) -> float:
            ratio = np.float32(self.protocol.strengths[k])
            errors = (spectral_error(record, true, transfer, ratio * below) for record, true, transfer, below in seen)
            return -sum(map(math.log, errors))

        return _climb(estimate, len(self.protocol.strengths) // 2, len(self.protocol.strengths))

    def _best(self, restorer: Restorer, tuning: Sequence[Photograph], start: int) -> tuple[int, dict[int, Singles]]:
        """Place of the best ε, looked for from ``start``, and the pictures that it restores."""
        ready = {key: self._restored(restorer, key) for key in map(id, tuning)}
        best, highest, kept = start, -math.inf, dict[int, Singles]()

        def mean(k: int) -> float:
            nonlocal best, highest, kept
            pictures = {key: restored(self.protocol.strengths[k]) for key, restored in ready.items()}
            each = [psnr(picture, self.scenes[key].true) for key, picture in pictures.items()]
            height = sum(each) / len(each)
            if height > highest:
                best, highest, kept = k, height, pictures
            return height

        _climb(mean, start, len(self.protocol.strengths))
        return best, kept

    def _score(self, key: int, picture: Singles, epsilon: float, restorer: str, chosen: str = "") -> Score:
        known, like = self.scenes[key], self.likenesses.get(key)
        bright = self.protocol.brightness(self.design)
        scored, true = _times(bright, picture), _times(bright, known.true)
        likeness, likeness_inner, colour, colour_inner = [math.nan] * 4
        if like is not None:
            likeness, likeness_inner = _means(like.ssim(scored), TRIM - 5)
        if like is not None and self.colours:
            colour, colour_inner = _means(like.delta_e(scored), TRIM)
        return Score(
            self.design.name,
            self.level_db,
            known.scene.name,
            epsilon,
            psnr(scored, true),
            likeness,
            psnr(inner(scored, TRIM), inner(true, TRIM)),
            likeness_inner,
            colour,
            colour_inner,
            restorer,
            chosen,
        )


def _means(values: NDArray[np.floating[Any]], trim: int) -> tuple[float, float]:
    """Over all of a map [..., rows, columns], and without ``trim`` elements at each edge."""
    return (
        float(values.mean(dtype=np.float64)),
        float(values[..., trim:-trim, trim:-trim].mean(dtype=np.float64)),
    )


def _times(bright: float, picture: Singles) -> Singles:
    return picture if bright == 1 else np.float32(bright) * picture


def _require_light(design: Design) -> None:
    """Refuse what passes nothing, before any photograph is looked at."""
    if not 0 < design.transmission <= 1:
        raise JobError(
            "MF104",
            f"the design passes {design.transmission:g} of the stop's light; it must be above 0 and at most 1",
            where=design.name,
            cure="Open some dots inside the stop",
        )


def _climb(height: Callable[[int], float], start: int, count: int) -> int:
    """Place, below ``count``, without a higher neighbour, by steps to the better one; no height is asked for twice."""
    known = cache(height)
    best, following = -1, start
    while following != best:
        best = following
        following = max((k for k in (best, best - 1, best + 1) if 0 <= k < count), key=known)
    return best


def stated_sensor(section: SensorSection | None) -> Sensor:
    """The sensor of [sensor]; protocol F1's without one.

    Raises:
        JobError: MF140 for a sensor that cannot be.
    """
    return Sensor() if section is None else Sensor(**dict(section))


def stated_light(section: ExposureSection | None, sensor: Sensor, camera: Camera) -> tuple[tuple[float, ...], str]:
    """Levels of [exposure] in dB, and how it states them; protocol F1's where it states none.

    Raises:
        JobError: MF141 for a light that cannot be.
    """
    if section is None or (section.snr, section.white, section.luminance) == (None, None, None):
        return LEVELS, in_decibels(LEVELS)
    if section.snr is not None:
        return section.snr, in_decibels(section.snr)
    if section.white is not None:
        found = Exposure.of_white(section.white, sensor)
    else:
        assert section.luminance is not None
        assert section.time is not None
        assert section.quantum_efficiency is not None
        found = Exposure.of_scene(
            section.luminance,
            section.time,
            section.quantum_efficiency,
            focal_ratio=camera.focal_um / camera.stop.diameter_um,
            pixel_um=camera.pixel_um,
            sensor=sensor,
        )
    return (found.level_db,), f"{found.stated}, {found.electrons:.0f} electrons behind the published display"


def in_decibels(levels: Sequence[float]) -> str:
    """Levels of light in words."""
    return f"signal-to-noise ratio of white behind the published display {', '.join(f'{each:g}' for each in levels)} dB"


def told(sensor: Sensor) -> str:
    """A sensor in words."""
    converter = "" if sensor.bits is None else f", {sensor.bits} bits, black level {sensor.black_level}"
    mosaic = "" if sensor.mosaic == "none" else f", mosaic {sensor.mosaic}"
    return f"full well {sensor.full_well:g} electrons, read noise {sensor.read_noise:g} electrons{converter}{mosaic}"


_OWN_WORDS = ("lens distortion", "curve of the rim", "field between places", "width of the bands")


def left_out(panel: Panel, scene: Scene, blank: MaskBlank, plan: Plan | None = None) -> tuple[str, ...]:
    """Sentences on what the photographs of a die leave out; none where they hold all that the job states.

    Args:
        panel: of the die.
        scene: of the job, the plate's glass in its gap.
        blank: of the plate.
        plan: that the transfer follows; None if it holds all of the scene.
    """
    return (*by_plan(scene, plan), *_of_lens(scene), *_of_plate(panel, scene, blank))


def by_sentence(left_out: Mapping[str, Sequence[str]]) -> list[str]:
    """Every sentence once, with the dies that it is about where these are not all.

    Args:
        left_out: by die, what its photographs leave out.
    """
    dies: dict[str, list[str]] = {}
    for name, told in left_out.items():
        for sentence in told:
            dies.setdefault(sentence, []).append(name)
    every = len(left_out)
    return [f"{'' if len(names) == every else ', '.join(names) + ': '}{sentence}." for sentence, names in dies.items()]


def by_plan(scene: Scene, plan: Plan | None) -> list[str]:
    """Sentences on what a plan leaves out of a scene; of none, on the shift that is then left out."""
    if plan is None:
        told = "the shift through the gap off the axis is left out: every place is seen as the axis is"
        return [told] if scene.gap_um and scene.field_um else []
    rows = [row for row in plan.ingredients if not row.modelled and row.error and row.name not in _OWN_WORDS]
    return [
        f"{row.name} is left out: without it the PSF errs by {row.error:.2g} at most, and the accuracy asked for is "
        f"{plan.accuracy:g}"
        for row in rows
    ]


def _of_lens(scene: Scene) -> list[str]:
    told = []
    if scene.distortion is not None and scene.distortion.ratio:
        told.append(
            f"lens distortion of {scene.distortion.ratio:.2g} is left out: photographs are compared as if rectified, "
            "and their PSF is that of a lens without it"
        )
    if scene.nearest_um != scene.farthest_um:
        near, far = (_distance(each) for each in (scene.nearest_um, scene.farthest_um))
        told.append(f"depth is left out: all of a photograph is at one distance between {near} and {far}")
    return told


def _of_plate(panel: Panel, scene: Scene, blank: MaskBlank) -> list[str]:
    told = []
    if blank.optical_density is not None:
        share = 10**-blank.optical_density
        told.append(
            f"light through the film is left out: it passes {share:.1g} of what falls on it, and is taken as opaque"
        )
    if blank.glass is not None:
        side = "its thickness counts as a gap" if blank.glass.gap_um else "behind it, it only dims"
        if blank.glass.gap_um and not scene.gap_um:
            side = "its thickness counts as a gap with a [scene] alone, and the job has none"
        told.append(f"reflections and absorption of the glass are left out: {side}")
    if panel.tracks:
        told.append("wires of the display are left out: the mask has none")
    return told


def _distance(length_um: float) -> str:
    return "infinity" if math.isinf(length_um) else f"{length_um / UM_PER_MM:.4g} mm"
