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
    ε is found by climbing on its grid: the best if the mean PSNR has one peak. The Wiener filter's is the best for one
    pixel of 16, every fourth of every fourth row; others' climbs start there and see all pixels.
    Where a mean over the noise is asked for and :mod:`maskfab.camera.expected` knows it, none is drawn for PSNR and ε.
    Under protocol ``paper`` errors count as bright as the design leaves them, so twice the light costs 6 dB, and edges
    beside darkness cost well-conditioned designs more than others. Its PSNRs compare with published ones; they do not
    rank designs of unequal light.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.base.errors import JobError
from maskfab.camera.expected import Still, Stills, climb
from maskfab.camera.imaging import Design, Isoplanatic, RestoredBy
from maskfab.camera.record import Noise, Record, Restorer, merged
from maskfab.camera.restorers.choice import Choice
from maskfab.camera.restorers.dct import EPSILON, Published
from maskfab.camera.restorers.wiener import Ready, Wiener
from maskfab.camera.scenes import Photograph, spectrum_of
from maskfab.camera.scores import Crop, Score, ScoreTable, Truth, inner, psnr
from maskfab.camera.sensor import F1_SENSOR, LEVELS, Exposure, record_light
from maskfab.job.camera import REFERENCE_TRANSMISSION, Sensor
from maskfab.optics.colour import code_of_light

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
ASSUMED = "an opaque film and no glass, whatever the job says of its plate"
"""Assumptions of protocol F1."""
WIENER = (Wiener(),)
AUTO = "auto"
"""Restorer of a score whose photograph was restored by the one that its record alone speaks for."""
_STEP = 4
"""Rows and columns between pixels that the Wiener filter's ε is chosen by; it divides every scene's sides."""
_OF_LIGHT, _OF_CODE = 100.0, 20.0
"""Electrons of white, times ε, where ε is looked for first: of linear light, and of code values."""
_CLEAR = 5.0
"""Standard deviations of the noise from the brightest light to a full well, beyond which nothing is clipped."""


@dataclass(frozen=True)
class Protocol:
    """A way to take photographs and to score them.

    Attributes:
        linear: scenes are linear light, and restored pictures are coded again before they are scored; otherwise code
            values are taken for light, as much of the literature does.
        whole: electrons of white behind the published display are rounded.
        dimmed: pictures are scored as bright as the design leaves them, relative to the published display.
        restorers: that belong to it; none where any may be asked for.
        brackets: exposures that are taken of every scene and merged, as the times by which their light is less than
            the level's; of scenes with highlights. Empty for one exposure, of any scene.
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

    def __post_init__(self) -> None:
        possible = all(math.isfinite(cut) and cut >= 1 for cut in self.brackets)
        if not possible or len(set(self.brackets)) < len(self.brackets):
            cuts = ", ".join(f"{cut:g}" for cut in self.brackets)
            what = f"brackets of {cuts} times less light than the level's; each must be 1 or more, and another"
            raise JobError("MF143", what, where="brackets", cure="Give numbers such as 1, 4 and 16")
        if self.brackets and not self.linear:
            what = "brackets are of light, and this protocol takes code values for it"
            cure = "Use protocol camera with linear light, or remove the brackets"
            raise JobError("MF143", what, where="brackets", cure=cure)

    def exposure(self, level_db: float) -> Exposure:
        """Light of a level. Raises JobError MF141 for no light, or for more than a full well."""
        return Exposure.at(level_db, self.sensor, whole=self.whole)

    def seen(self, design: Design, scene: Photograph) -> Singles:
        """Light of one scene on the sensor behind one design, white is 1 before it, [3, rows, columns]."""
        seen, margin = design.seen if isinstance(design, RestoredBy) else design, scene.margin
        if isinstance(seen, Isoplanatic) and not margin.large:
            # A copy, or what lies beyond the sensor would be held as well.
            return margin.blurred(spectrum_of(scene, linear=self.linear), seen.on(margin.shape)).copy()
        return seen.blurred(scene.light if self.linear else scene.values, margin)

    def record(self, seen: Singles, design: Design, scene: Photograph, level_db: float) -> Record:
        """Light of a scene as ``seen``, in noise of its own: the same for every design at a level.

        Brackets share the gain at which white of the longest fits, or the shorter would hold no highlights either.
        """
        light, cuts, taken = self.exposure(level_db), self.brackets or (1.0,), []
        white = light.behind(design.transmission)
        gain = self.sensor.gain_for(white / min(cuts))
        for cut in cuts:
            seed = 1000 * scene.number + round(light.electrons / cut)
            taken.append(record_light(self.sensor, seen, white / cut, seed, gain=gain))
        return taken[0] if len(taken) == 1 else merged(taken)

    def photograph(self, design: Design, scene: Photograph, level_db: float) -> Record:
        """One scene through one design at one level of light."""
        return self.record(self.seen(design, scene), design, scene, level_db)

    def restored(
        self, seen: Singles, design: Design, scene: Photograph, level_db: float, epsilon: float, crop: Crop
    ) -> Singles:
        """Code values of part of a photograph of light as ``seen``, restored by the Wiener filter."""
        record = self.record(seen, design, scene, level_db)
        return self.shown(crop.of(Wiener().prepare(record, design)(epsilon)))

    def noise(self, seen: Iterable[Singles], design: Design, level_db: float) -> Noise | None:
        """Noise of records of light as ``seen``, where the same variance by light is all that there is to it.

        None for a sensor that rounds, interpolates or has banding, for brackets, and where a full well may clip.
        """
        plain = self.sensor.bits is None and self.sensor.mosaic == "none" and not self.sensor.banding
        white = self.exposure(level_db).behind(design.transmission)
        sensor = self.sensor.amplified(self.sensor.gain_for(white))
        most = white * max(float(light.max()) for light in seen)
        clipped = most + _CLEAR * math.sqrt(max(most, 0) + sensor.read_noise**2) > sensor.full_well
        return Noise(white, sensor.read_noise) if plain and not clipped and not self.brackets else None

    def start(self, white: float) -> int:
        """Place of the ε that is looked for first in light of so many electrons of white."""
        usual = _OF_LIGHT if self.linear else _OF_CODE
        return int(abs(np.log(np.multiply(self.strengths, white / usual))).argmin())

    def check(self, scene: Photograph) -> None:
        """Refuse brackets of a scene that has no light above white. Raises JobError MF143."""
        if not self.brackets or (scene.measured is not None and scene.measured.max() > 1):
            return
        reason = "code values, which end at white" if scene.measured is None else "no light above white"
        what = f"brackets are for highlights, and this scene has {reason}"
        cure = "Give EXR or HDR photographs and the light in them that is white, or remove the brackets"
        raise JobError("MF143", what, where=scene.name, cure=cure)

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
    expected: bool = False,
    seen: Mapping[str, Singles] = MappingProxyType({}),
    show: Callable[[Score, Singles], None] | None = None,
) -> ScoreTable:
    """Score every design on every test scene at every level, restored in every way.

    Args:
        tuning: scenes to choose ε on; they may be test scenes, though that flatters by a few hundredths of a decibel.
        levels: signal-to-noise ratios of white behind the published display, dB.
        choose: score the one that each photograph's record speaks for too, as :data:`AUTO`.
        details: score SSIM and S-CIELAB too, which takes half of the time.
        colours: of these, S-CIELAB.
        expected: take PSNR on the mean over the noise and choose ε by it, rather than in one draw, where the Wiener
            filter alone restores and :meth:`Protocol.noise` is all that the sensor adds.
        seen: light of scenes behind the one design, by their names, where it is known; as of :meth:`Protocol.seen`.
        show: given every score with its restored picture, float32 [3, rows, columns] of the sensor, row 0 on top.

    Raises:
        JobError: MF105 without designs, levels, scenes or restorers, or for two of one name; MF104 for a closed design;
            MF141 for a level without light, or above a full well; MF134 behind a camera of other than three
            wavelengths; MF143 for brackets of a scene that has no light above white.
    """
    _check(designs, test, tuning, levels, protocol, restorers)
    scenes = {id(s): s.dark if protocol.dark else s for s in (*tuning, *test)}
    likenesses: dict[float, dict[int, Truth]] = {}
    scores: list[Score] = []
    for design in designs:
        bright = protocol.brightness(design)
        if details and bright not in likenesses:
            likenesses = {bright: {id(s): Truth(_times(bright, scenes[id(s)].true)) for s in test}}
        light = {
            key: seen[scene.name] if scene.name in seen else protocol.seen(design, scene)
            for key, scene in scenes.items()
            if not scene.margin.large
        }
        known: dict[float, tuple[float, Noise, Stills]] = {}
        if expected and tuple(restorers) == WIENER and not choose and len(light) == len(scenes) and not protocol.dimmed:
            known = _known(protocol, design, levels, scenes, light, [*map(id, tuning)])
        for level in sorted(levels):
            case = _Case(protocol, design, level, scenes, light, likenesses.get(bright, {}), colours)
            if level in known:
                scored = case.expected(test, *known[level], pictures=show is not None)
            else:
                scored = case.scored(test, tuning, restorers, choose=choose)
            for score, picture in scored:
                scores.append(score)
                if show is not None and picture is not None:
                    show(score, picture)
    return ScoreTable(tuple(scores))


def _check(
    designs: Sequence[Design],
    test: Sequence[Photograph],
    tuning: Sequence[Photograph],
    levels: Sequence[float],
    protocol: Protocol,
    restorers: Sequence[Restorer],
) -> None:
    """Refuse what :func:`evaluate` refuses."""
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
        if not 0 < design.transmission <= 1:
            what = f"the design passes {design.transmission:g} of the stop's light; it must be above 0 and at most 1"
            raise JobError("MF104", what, where=design.name, cure="Open some dots inside the stop")


def _known(
    protocol: Protocol,
    design: Design,
    levels: Sequence[float],
    scenes: Mapping[int, Photograph],
    seen: Mapping[int, Singles],
    tuning: Sequence[int],
) -> dict[float, tuple[float, Noise, Stills]]:
    """The ε that is best on the mean over the noise, that noise, and what tells every scene's error, by level."""
    by_level = {level: protocol.noise(seen.values(), design, level) for level in levels}
    noises = {level: noise for level, noise in by_level.items() if noise is not None}
    strengths = protocol.strengths
    last, best = len(strengths) - 1, {level: protocol.start(noise.electrons) for level, noise in noises.items()}
    light = {key: Still.of(scenes[key].true, each) for key, each in seen.items()} if noises else {}
    low, high, stills = last + 1, -1, None
    # Beyond what they were restored by pictures of other ε are not known.
    while not all(low <= max(place - 1, 0) and min(place + 1, last) <= high for place in best.values()):
        low, high = max(0, min(low, *best.values()) - 2), min(last, max(high, *best.values()) + 3)
        stills = Stills.of(design, light, (strengths[low], strengths[high]), linear=protocol.linear)
        for level, noise in noises.items() if last else ():
            best[level] = stills.best(tuning, noise, strengths, best[level])
    return {} if stills is None else {level: (strengths[best[level]], noise, stills) for level, noise in noises.items()}


@dataclass(frozen=True, eq=False)
class _Case:
    """One design at one level of light; scenes by their ``id``."""

    protocol: Protocol
    design: Design
    level_db: float
    scenes: Mapping[int, Photograph]
    seen: Mapping[int, Singles]
    likenesses: Mapping[int, Truth]
    colours: bool
    _records: dict[int, Record] = field(default_factory=dict, init=False, repr=False)
    """Of those scenes; records of others are made again for each that restores them."""

    def expected(
        self, test: Sequence[Photograph], epsilon: float, noise: Noise, stills: Stills, *, pictures: bool
    ) -> Iterator[tuple[Score, Singles | None]]:
        """Scores on the mean over the noise, with pictures in a draw of it where these are wanted or scored too."""
        for key, heights in stills.psnrs(map(id, test), epsilon, noise, TRIM):
            picture = self._restored(Wiener(), key)(epsilon) if pictures or self.likenesses else None
            yield self._score(key, picture, epsilon, Wiener().name, heights=heights), picture

    def scored(
        self, test: Sequence[Photograph], tuning: Sequence[Photograph], restorers: Sequence[Restorer], *, choose: bool
    ) -> Iterator[tuple[Score, Singles]]:
        keys, strengths, ready, start = [*map(id, tuning)], self.protocol.strengths, dict[int, Ready](), 0
        if len(strengths) > 1:
            ready = {key: Wiener().prepare(self._record(key), self.design) for key in keys}
            start = self._sampled(ready)
        epsilons = dict[str, float]()
        for restorer in restorers:
            if ready and restorer == Wiener():
                best, pictures = start, {key: self.protocol.shown(one(strengths[start])) for key, one in ready.items()}
            else:
                best, pictures = self._best(restorer, keys, start)
            epsilon = epsilons[restorer.name] = strengths[best]
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
        light = self.seen.get(key)
        if light is None:
            return self.protocol.photograph(self.design, self.scenes[key], self.level_db)
        if key not in self._records:
            self._records[key] = self.protocol.record(light, self.design, self.scenes[key], self.level_db)
        return self._records[key]

    def _restored(self, restorer: Restorer, key: int) -> Callable[[float], Singles]:
        prepared = restorer.prepare(self._record(key), self.design)
        return lambda epsilon: self.protocol.shown(prepared(epsilon))

    def _sampled(self, ready: Mapping[int, Ready]) -> int:
        """Place of the ε of the Wiener filter that is best for one pixel of 16."""
        true = {key: self.scenes[key].true[:, ::_STEP, ::_STEP] for key in ready}
        white = self.protocol.exposure(self.level_db).behind(self.design.transmission)

        def total(k: int) -> float:
            epsilon = self.protocol.strengths[k]
            return sum(psnr(self.protocol.shown(one.sampled(epsilon, _STEP)), true[key]) for key, one in ready.items())

        return climb(total, self.protocol.start(white), len(self.protocol.strengths))

    def _best(self, restorer: Restorer, tuning: Sequence[int], start: int) -> tuple[int, dict[int, Singles]]:
        """Place of the best ε, looked for from ``start``, and the pictures that it restores."""
        ready = {key: self._restored(restorer, key) for key in tuning}
        best, highest, kept = start, -math.inf, dict[int, Singles]()

        def mean(k: int) -> float:
            nonlocal best, highest, kept
            pictures = {key: restored(self.protocol.strengths[k]) for key, restored in ready.items()}
            heights = [psnr(picture, self.scenes[key].true) for key, picture in pictures.items()]
            height = sum(heights) / len(heights)
            if height > highest:
                best, highest, kept = k, height, pictures
            return height

        climb(mean, start, len(self.protocol.strengths))
        return best, kept

    def _score(
        self,
        key: int,
        picture: Singles | None,
        epsilon: float,
        restorer: str,
        chosen: str = "",
        heights: tuple[float, float] | None = None,
    ) -> Score:
        """Score of a picture; of PSNRs that are known without it where ``heights`` are given."""
        scene, like, drawn = self.scenes[key], self.likenesses.get(key), heights is None
        likeness, likeness_inner, colour, colour_inner = [math.nan] * 4
        if picture is not None:
            bright = self.protocol.brightness(self.design)
            scored, true = _times(bright, picture), _times(bright, scene.true)
            heights = heights or (psnr(scored, true), psnr(inner(scored, TRIM), inner(true, TRIM)))
            if like is not None:
                likeness, likeness_inner = _means(like.ssim(scored), TRIM - 5)
            if like is not None and self.colours:
                colour, colour_inner = _means(like.delta_e(scored), TRIM)
        assert heights is not None
        return Score(
            self.design.name,
            self.level_db,
            scene.name,
            epsilon,
            heights[0],
            likeness,
            heights[1],
            likeness_inner,
            colour,
            colour_inner,
            restorer,
            chosen,
            drawn,
        )


def _means(values: NDArray[np.floating[Any]], trim: int) -> tuple[float, float]:
    """Means over a map [..., rows, columns], and without ``trim`` elements at each edge."""
    return (float(values.mean(dtype=np.float64)), float(values[..., trim:-trim, trim:-trim].mean(dtype=np.float64)))


def _times(bright: float, picture: Singles) -> Singles:
    return picture if bright == 1 else np.float32(bright) * picture
