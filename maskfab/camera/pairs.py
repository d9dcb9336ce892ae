"""Pairs to train restorers on: crops of photographs as they are, and as a camera behind a die takes them.

A crop is cut from a larger window of its photograph, so that the light that falls into it from outside is the
photograph's own. Pairs of one photograph share windows and dies in groups, for blurring a window takes most of the
time; their places in it, light and noise are their own. With L the electrons of white behind the die and g the gain,

    blurred = window * PSF,        raw = round(min(Poisson(L blurred) + σ N, full well / g) g / step) + black level

of the one colour that each pixel records, as :mod:`maskfab.camera.sensor` takes every photograph. The camera's picture
has the missing colours from neighbours, white at its last code, and the sRGB curve, nothing else.

Every number is drawn from the seed and the pair's own number, so that a pair is the same whoever makes it, and when.
Which photographs are for training follows from the seed and their names: all crops of one are on one side.

Notes:
    A window is as large as all photographs allow, 1536 pixels at most, and no larger than pairs of one photograph and
    their surroundings need, laid side by side. The blur is circular, so light from beyond the surroundings is the
    window's own, from its other side; its share is told for every die.
    Poisson's counts come from a series, exact but for every 400th pixel at most, there off by one.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Singles, fast_length
from maskfab.base.errors import JobError
from maskfab.camera.imaging import MARGIN, Margin, Transfer
from maskfab.camera.record import interpolated, sampled
from maskfab.camera.scenes import NARROW, checked_pixels
from maskfab.camera.sensor import read_codes
from maskfab.display.pictures import read_picture
from maskfab.job.camera import Sensor
from maskfab.optics.colour import code_of_light, light_of_code

SPLITS = ("train", "validation", "test")
_WIDEST, _SMALLEST = 1536, 32
"""Pixels along a side of a window, unless one crop needs more, and of the smallest crop."""
_MANY = 4
"""Crops side by side in a window from which on random places spread so that twice as many share it."""
_MOST_LIGHT = 65504.0
"""In half precision."""

Pair: TypeAlias = dict[str, Any]


@dataclass(frozen=True)
class Wanted:
    """Pairs as they are asked for, as :func:`maskfab.api.pairs.pairs` takes it.

    Raises:
        JobError: MF104, MF105 for what cannot be.
    """

    count: int
    seed: int = 0
    crop: int = 256
    bits: int = 8
    validation: float = 0.1
    test: float = 0.1
    white: float | None = None

    def __post_init__(self) -> None:
        if self.count < 1:
            raise JobError("MF104", f"{self.count} pairs are none", where="count", cure="Give 1 or more")
        if self.seed < 0:
            raise JobError("MF104", f"a seed of {self.seed} is below 0", where="seed", cure="Give 0 or more")
        if self.crop < _SMALLEST or self.crop % 2:
            what = f"crops of {self.crop} pixels are odd or smaller than {_SMALLEST}, and a mosaic repeats every second"
            cure = f"Give an even number from {_SMALLEST} on, such as 256"
            raise JobError("MF104", what, where="crop", cure=cure)
        if self.bits not in (8, 10):
            raise JobError("MF105", f"no picture of {self.bits} bits is made", where="bits", cure="Give 8 or 10")
        for key, share in {"validation": self.validation, "test": self.test}.items():
            if not (math.isfinite(share) and share >= 0 and self.validation + self.test < 1):
                what = f"shares of {self.validation:g} and {self.test:g} for validation and test leave none to train on"
                raise JobError("MF104", what, where=key, cure="Give 0 or more each, together less than 1, such as 0.1")


@dataclass(frozen=True)
class Source:
    """A photograph; its shape is rows and columns as it is seen."""

    path: Path
    sha256: str
    shape: tuple[int, int]


@dataclass(frozen=True)
class PairDie:
    """A die that pairs are taken through.

    Attributes:
        electrons: of white behind it, at each level of light.
        beyond: share of a point's light that falls farther than the surroundings are wide, of the worst colour.
        left_out: sentences on what its blur leaves out.
    """

    name: str
    transmission: float
    electrons: tuple[float, ...]
    beyond: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Window:
    """A part of photographs that is blurred at once.

    Attributes:
        margin: its rows and columns, and how many of them at each edge no crop reaches into.
        groups: crops that share one window of a photograph: as many as would lie side by side in it, or twice as many.
    """

    margin: Margin
    groups: int

    @classmethod
    def of(cls, crop: int, sources: Sequence[Source], pairs_each: int) -> Window:
        """For crops of photographs, so many pairs of each. Raises JobError MF121 if one is too small."""
        least = min(sources, key=lambda source: min(source.shape))
        around = MARGIN if min(least.shape) >= crop + 2 * MARGIN else NARROW
        if min(least.shape) < crop + 2 * around:
            what = (
                f"the photograph has {least.shape[1]} x {least.shape[0]} pixels, and a crop of {crop} with {around} "
                f"round it, whose light reaches it, has {crop + 2 * around}"
            )
            cure = f"Remove it, or give {_SMALLEST + 2 * NARROW} pixels or more, and smaller crops: crop = {_SMALLEST}"
            raise JobError("MF121", what, where=str(least.path), cure=cure)
        room = [min(source.shape[axis] for source in sources) for axis in (0, 1)]
        along = [1, 1]
        for axis in (0, 1) * (_WIDEST // crop):
            longer = _fast(2 * around + (along[axis] + 1) * crop)
            along[axis] += math.prod(along) < pairs_each and longer <= min(room[axis], _WIDEST)
        rows, columns = (min(_fast(2 * around + n * crop), side // 2 * 2) for n, side in zip(along, room, strict=True))
        return cls(Margin((rows, columns), around), math.prod(along) * (2 if math.prod(along) >= _MANY else 1))


def _fast(least: int) -> int:
    """Least even number of at least so many points of which transforms are fast."""
    return 2 * fast_length(-(-least // 2))


class Drawn(NamedTuple):
    """Chances of a pair: the first one that shares its window, places in the photograph, numbers of die and level."""

    number: int
    source: int
    group: int
    window: tuple[int, int]
    crop: tuple[int, int]
    die: int
    level: int


@dataclass(frozen=True)
class Plan:
    """Everything that pairs follow from but the dies' transfers.

    Attributes:
        sources: photographs, those of each split together.
        splits: how many of them are for training, validation and test.
        levels: of light, dB.
    """

    wanted: Wanted
    sources: tuple[Source, ...]
    splits: tuple[int, int, int]
    dies: tuple[PairDie, ...]
    levels: tuple[float, ...]
    sensor: Sensor
    window: Window

    def first(self, source: int) -> int:
        """Number of the first pair of a photograph; behind the last one the number of all."""
        return -(-source * self.wanted.count // len(self.sources))

    @property
    def side_by_side(self) -> int:
        """Crops that the smallest photograph holds without overlap, its surroundings left out."""
        spare = 2 * self.window.margin.width
        return min(math.prod((side - spare) // self.wanted.crop for side in source.shape) for source in self.sources)

    def of_split(self, split: str) -> range:
        """Numbers of its pairs."""
        place = SPLITS.index(split)
        before = sum(self.splits[:place])
        return range(self.first(before), self.first(before + self.splits[place]))

    def drawn(self, number: int) -> Drawn:
        """Chances of a pair."""
        margin, crop, groups = self.window.margin, self.wanted.crop, self.window.groups
        source = number * len(self.sources) // self.wanted.count
        group = self.first(source) + (number - self.first(source)) // groups * groups
        shared, own = (np.random.default_rng([self.wanted.seed, *of]) for of in ((group, 0), (number, 1)))
        sides = zip(self.sources[source].shape, margin.shape, strict=True)
        top, left = (int(shared.integers(have - side + 1)) for have, side in sides)
        die = int(shared.integers(len(self.dies)))
        down, right = (margin.width + int(own.integers(side - 2 * margin.width - crop + 1)) for side in margin.shape)
        level = int(own.integers(len(self.levels)))
        return Drawn(number, source, group, (top, left), (top + down, left + right), die, level)

    def row(self, drawn: Drawn) -> dict[str, Any]:
        """Facts of a pair; rows and columns count from the photograph's top left corner."""
        die = self.dies[drawn.die]
        electrons = die.electrons[drawn.level]
        return {
            "number": drawn.number,
            "photograph": self.sources[drawn.source].path.name,
            "top": drawn.crop[0],
            "left": drawn.crop[1],
            "die": die.name,
            "level_db": float(self.levels[drawn.level]),
            "electrons_of_white": electrons,
            "gain": float(self.sensor.gain_for(electrons)),
        }


def by_split(names: Sequence[str], wanted: Wanted) -> tuple[list[int], tuple[int, int, int]]:
    """Places of photographs in an order that follows from the seed and their names, and how many are in each split.

    Of two or more each share above 0 has one at least; training has what is left.
    """
    order = sorted(range(len(names)), key=lambda k: hashlib.sha256(f"{wanted.seed}/{names[k]}".encode()).digest())
    test, validation = (max(round(s * len(names)), 1) if s > 0 else 0 for s in (wanted.test, wanted.validation))
    # Of few photographs the first is for training, the next for the test.
    test = min(test, len(names) - 1)
    validation = min(validation, len(names) - 1 - test)
    return order, (len(names) - validation - test, validation, test)


@dataclass(eq=False)
class Pairs:
    """Pairs by their place, made when they are asked for: what torch's ``DataLoader`` takes.

    One is a dictionary: ``clean`` and ``blurred``, float16 [3, rows, columns] of linear light, white is 1; ``raw``,
    uint16 [rows, columns], codes of the mosaic; ``coded``, uint8 or uint16 [3, rows, columns], the camera's picture;
    and ``number``, ``photograph``, ``top``, ``left``, ``die``, ``level_db``, ``electrons_of_white`` and ``gain``.
    The last photograph and window are kept, so pairs in the order of their places take no longer than files of them;
    shuffled, each takes a window of its own, unless :meth:`order` shuffles them.

    Attributes:
        transfers: H of each die on windows, as of :class:`maskfab.camera.imaging.Blur`.
        numbers: of the pairs that are in it.
        datasheet: what they follow from, and what is in them.
    """

    plan: Plan
    transfers: Mapping[str, Transfer]
    numbers: range
    datasheet: Mapping[str, Any] = field(default_factory=dict, repr=False)
    _kept: tuple[int, Singles] | None = field(default=None, init=False, repr=False)

    def __len__(self) -> int:
        return len(self.numbers)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "_kept": None}

    def __getitem__(self, place: int) -> Pair:
        plan = self.plan
        drawn, wanted = plan.drawn(self.numbers[place]), plan.wanted
        row = plan.row(drawn)
        light, margin = light_of(plan.sources[drawn.source].path, wanted.white), plan.window.margin
        if self._kept is None or self._kept[0] != drawn.group:
            window = _cut(light, drawn.window, margin.shape).astype(np.float32)
            self._kept = drawn.group, margin.through(window, self.transfers[row["die"]])
        down, right = (crop - window - margin.width for crop, window in zip(drawn.crop, drawn.window, strict=True))
        shape = wanted.crop, wanted.crop
        blurred = _cut(self._kept[1], (down, right), shape)
        sensor = plan.sensor.amplified(row["gain"])
        draw = np.random.default_rng([wanted.seed, drawn.number, 2])
        codes = read_codes(sensor, sampled(blurred), row["electrons_of_white"], draw)
        assert sensor.bits is not None
        most = 2**sensor.bits - 1 - sensor.black_level
        curve = _curve(most, sensor.step / row["electrons_of_white"], wanted.bits)
        # The sixteenths that neighbours' means have are whole numbers, which single precision holds.
        sixteenths = np.clip(np.float32(16) * interpolated(codes), 0, 16 * most).astype(np.int32)
        return {
            "clean": np.ascontiguousarray(_cut(light, drawn.crop, shape)),
            "blurred": np.ascontiguousarray(blurred, dtype=np.float16),
            "raw": (codes + np.float32(sensor.black_level)).astype(np.uint16),
            "coded": curve.take(sixteenths),
            **row,
        }

    def of_split(self, split: str) -> Pairs:
        """Pairs for ``train``, ``validation`` or ``test`` alone."""
        if split not in SPLITS:
            cure = f"Use {', '.join(SPLITS)}"
            raise JobError("MF105", f"there is no split {split!r}", where="split", cure=cure)
        return replace(self, numbers=self.plan.of_split(split))

    def order(self, seed: int) -> list[int]:
        """Places shuffled so that pairs of one window stay together: a sampler that takes no longer than the files."""
        draw = np.random.default_rng(seed)
        by_group = np.array([self.plan.drawn(number).group for number in self.numbers])
        groups = draw.permutation(np.unique(by_group))
        return [int(place) for group in groups for place in draw.permutation(np.flatnonzero(by_group == group))]


def _cut(planes: NDArray[Any], place: tuple[int, int], shape: tuple[int, int]) -> NDArray[Any]:
    return planes[:, place[0] : place[0] + shape[0], place[1] : place[1] + shape[1]]


@lru_cache(maxsize=64)
def _curve(most: int, light: float, bits: int) -> NDArray[np.unsignedinteger[Any]]:
    """sRGB codes of so many bits, by sixteenths of a sensor's code, each code so much light."""
    codes = code_of_light(np.arange(16 * most + 1) * (light / 16)) * (2**bits - 1)
    return np.asarray(np.rint(codes), dtype=np.uint8 if bits <= 8 else np.uint16)


@lru_cache(maxsize=1)
def light_of(path: Path, white: float | None) -> NDArray[np.float16]:
    """Linear light of the photograph that was looked at last, [3, rows, columns], white is 1; errors as of a scene's,
    but for its size."""
    picture = read_picture(path)
    colours = checked_pixels(path, picture, white)
    if not (most := float(colours.max()) / (white or 1.0)) <= _MOST_LIGHT:
        what = f"the photograph holds {most:.3g} times white, and half precision {_MOST_LIGHT:g}"
        raise JobError("MF121", what, where=str(path), cure="Cut its light at that, or state a brighter white")
    planes = np.empty((3, *colours.shape[:2]), dtype=np.float16)
    for plane, colour in zip(planes, (0, 1, 2) if colours.shape[2] == 3 else (0, 0, 0), strict=True):
        values = colours[:, :, colour]
        plane[:] = light_of_code(values) if picture.coded else values / np.float32(white or 1.0)
    return planes
