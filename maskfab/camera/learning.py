"""Training of a network to restore photographs behind one die, and the checkpoint that it leaves.

Lessons are photographs through the die, as the network is shown them, beside the truth: whole frames with light from
outside the sensor, taken by the protocol that scores them. Every second one is of a picture that is given, if any is,
mirrored by chance; the others are dead leaves that no other protocol draws: of four, one bright and one indoors are
smooth, and the other two have a texture, as few things in life are even.

Training goes step by step, so that it can be cut off anywhere and go on to the same result. A step descends (Kingma,
Ba, Adam, ICLR 2015) on the squared error of a few patches, as it is scored, over that of the whole picture that is
mended, so that dim scenes count as much as bright ones. What is used is the mean of the weights over the last steps
(Polyak, Juditsky, SIAM J. Control Optim. 30, 838, 1992), which is good whenever training stops. A run ends by the
clock, judges what it has by scenes that are not taught, and keeps it in a checkpoint: the network, what it was trained
behind, and all that training needs to go on.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import torch
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Singles
from maskfab.base.errors import JobError, SourceError
from maskfab.base.files import RUN, no_file, read_state, save_state
from maskfab.base.work import Clock, Progress
from maskfab.camera.imaging import Blur, Design, Transfer
from maskfab.camera.protocol import Protocol, evaluate
from maskfab.camera.restorers.dct import Dct
from maskfab.camera.restorers.network import COLOURS, EXPONENT, PLANES, Learned, Network, View, light_of
from maskfab.camera.scenes import LONG, SHORT, Photograph, dead_leaves, indoors, lit
from maskfab.camera.scores import psnr
from maskfab.optics.colour import code_of_light

_FIRST, _APART = 10_000_000, 100_000
"""Numbers of scenes of seed 0, and of the next."""


@dataclass(frozen=True, eq=False)
class Lesson:
    """One photograph: ``shown`` of its record, [planes, rows, columns], ``true`` code values, [3, rows, columns]."""

    shown: Singles
    true: Singles


@dataclass(frozen=True, eq=False)
class Lessons:
    """All lessons behind a design, by their number, the same every time; one of ``levels`` (dB) is drawn for each."""

    protocol: Protocol
    design: Design
    levels: tuple[float, ...]
    view: View
    photographs: Sequence[Photograph] = ()
    seed: int = 0
    shape: tuple[int, int] = (SHORT, LONG)

    def __call__(self, number: int) -> Lesson:
        """One of them."""
        turn = number // 2 if self.photographs else number
        own = _FIRST + _APART * self.seed + number
        level = float(np.random.default_rng([own, 2]).choice(self.levels))
        if self.photographs and number % 2:
            scene = mirrored(self.photographs[turn % len(self.photographs)], own)
        else:
            scene = drawn(own, turn, self.shape, lamps=bool(self.protocol.brackets))
        return self.of(scene, level)

    def of(self, scene: Photograph, level: float) -> Lesson:
        """The lesson that a scene is at a level of light."""
        record = self.protocol.photograph(self.design, scene, level)
        return Lesson(self.view.planes(record, self.design), scene.true)


def drawn(seed: int, turn: int, shape: tuple[int, int] = (SHORT, LONG), *, lamps: bool = False) -> Photograph:
    """Dead leaves, indoors and textured in turns of four, with lamps if exposures are merged."""
    scene = dead_leaves(seed, *shape)
    if turn % 4 >= 2:
        scene = textured(scene)
    if turn % 2:
        scene = indoors(scene)
    return lit(scene) if lamps else scene


def textured(scene: Photograph) -> Photograph:
    """The scene times a pattern that is log-normal, of a random contrast, and of a power that falls as f^-2 to f^-3."""
    draw = np.random.default_rng([scene.number, 1])
    rows, columns = scene.values.shape[1:]
    slope, contrast = draw.uniform(1.0, 1.5), draw.uniform(0.1, 0.6)
    y, x = scipy.fft.fftfreq(rows)[:, None], scipy.fft.rfftfreq(columns)
    frequency = np.hypot(y, x)
    frequency[0, 0] = np.inf
    grain = scipy.fft.rfft2(draw.standard_normal((rows, columns), dtype=np.float32), workers=1)
    pattern = scipy.fft.irfft2(grain * frequency**-slope, s=(rows, columns), workers=1)
    pattern *= contrast / pattern.std()
    values = scene.values * np.exp(pattern - contrast**2 / 2).astype(np.float32)
    return replace(scene, values=np.clip(values, 0, 1))


def mirrored(scene: Photograph, seed: int) -> Photograph:
    """A photograph turned left to right, upside down, both or neither, in noise of its own."""
    down, across = (slice(None, None, int(step)) for step in np.random.default_rng(seed).choice((-1, 1), 2))
    measured = None if scene.measured is None else np.ascontiguousarray(scene.measured[:, down, across])
    values = np.ascontiguousarray(scene.values[:, down, across])
    return replace(scene, number=seed, values=values, measured=measured)


def kept_for_validation(
    photographs: Sequence[Photograph], count: int, shape: tuple[int, int] = (SHORT, LONG), *, lamps: bool = False
) -> tuple[list[Photograph], Sequence[Photograph]]:
    """Scenes, so many drawn, that nothing is learned from (the last photograph if several), and the other ones."""
    held_back = [drawn(_FIRST - 1 - k, 3 * k, shape, lamps=lamps) for k in range(count)]
    if len(photographs) < 2:
        return held_back, photographs
    return [*held_back, photographs[-1]], photographs[:-1]


Arrays = dict[str, NDArray[np.generic]]

_UNSURE = 16
"""Pixels at the sides of a patch, but not of the picture, that do not count: the network lacks what is beyond."""
MEAN = "mean_"
"""Names of the weights that are used begin so."""
_SLOWER = 1000
"""Steps after which the rate falls as one over the root of their number."""
_WARM = 100


@dataclass(frozen=True)
class Course:
    """Settings of a training.

    Attributes:
        patch: rows and columns, at most those of a lesson.
        known: lessons at a time; beyond, the oldest makes way for a new one.
        fresh: steps after which a new one is given.
    """

    seed: int = 0
    widths: tuple[int, ...] = (32, 48, 64, 64)
    rate: float = 2e-3
    patch: tuple[int, int] = (128, 256)
    patches: int = 2
    first: int = 4
    known: int = 12
    fresh: int = 100


class Training:
    """A network on its way."""

    def __init__(self, course: Course, lesson: Callable[[int], Lesson], device: str = "cpu") -> None:
        self.course, self.device, self.step = course, torch.device(device), 0
        self._lesson = lesson
        self._known: dict[int, tuple[Lesson, float]] = {}
        # Weights follow from the seed alone, and nobody else's draws change.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(course.seed)
            self.network, self.mean = (Network(PLANES, self.course.widths).to(self.device) for _ in range(2))
        self.mean.load_state_dict(self.network.state_dict())
        self._descent = torch.optim.Adam(self.network.parameters(), lr=course.rate, betas=(0.9, 0.99))

    def advance(self) -> float:
        """One step; the loss before it, 1 for the picture that is mended."""
        course = self.course
        shown, true, weight = (torch.from_numpy(patch).to(self.device) for patch in self._patches())
        rate = course.rate * min(1.0, (self.step + 1) / _WARM) * min(1.0, (_SLOWER / (self.step + 1)) ** 0.5)
        for group in self._descent.param_groups:
            group["lr"] = rate
        mended = self.network(shown.contiguous(memory_format=torch.channels_last))
        loss = ((coded(mended) - true) ** 2 * weight).sum() / (COLOURS * (weight > 0).sum())
        self._descent.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), 1.0)
        self._descent.step()
        self.step += 1
        share = max(0.005, 4 / (self.step + 4))
        with torch.no_grad():
            for mean, now in zip(self.mean.parameters(), self.network.parameters(), strict=True):
                mean.lerp_(now, share)
        return float(loss.item())

    def get_ready(self) -> range:
        """Make the lessons of the next step, which takes longer than a step; their numbers."""
        newest = self.course.first + self.step // self.course.fresh
        numbers = range(max(0, newest - self.course.known), newest)
        for number in [each for each in self._known if each not in numbers]:
            del self._known[number]
        for number in numbers:
            if number not in self._known:
                lesson = self._lesson(number)
                before = code_of_light(light_of(lesson.shown[:COLOURS]))
                error = np.square(before - lesson.true).mean(dtype=np.float64)
                self._known[number] = lesson, float(error)
        return numbers

    def _patches(self) -> tuple[Singles, Singles, Singles]:
        """Planes that are shown, the truth, and the weight of every pixel, each [patches, planes, rows, columns]."""
        numbers = self.get_ready()
        draw = np.random.default_rng([self.course.seed, self.step])
        cut = [self._patch(draw, *self._known[int(draw.choice(numbers))]) for _ in range(self.course.patches)]
        shown, true, weight = (np.stack(stack) for stack in zip(*cut, strict=True))
        return shown, true, weight

    def _patch(self, draw: np.random.Generator, lesson: Lesson, error: float) -> tuple[Singles, Singles, Singles]:
        (rows, sure_rows), (columns, sure_columns) = (
            _side(draw, whole, side) for whole, side in zip(lesson.true.shape[1:], self.course.patch, strict=True)
        )
        place = slice(None), rows, columns
        weight = np.zeros_like(lesson.true[place][:1])
        weight[:, sure_rows, sure_columns] = 1 / max(error, 1e-9)
        return lesson.shown[place], lesson.true[place], weight

    def state(self) -> Arrays:
        """Everything that the next step depends on."""
        tensors = {f"now_{name}": tensor for name, tensor in self.network.state_dict().items()}
        tensors |= {f"{MEAN}{name}": tensor for name, tensor in self.mean.state_dict().items()}
        for place, moments in self._descent.state_dict()["state"].items():
            tensors |= {f"moment_{place}_{name}": moment for name, moment in moments.items()}
        return {"step": np.array(self.step), **{name: tensor.cpu().numpy().copy() for name, tensor in tensors.items()}}

    def restore(self, state: Mapping[str, NDArray[np.generic]]) -> None:
        """Go back to a state of the same course."""
        self.step = int(state["step"])
        self.network.load_state_dict(named("now_", state))
        self.mean.load_state_dict(named(MEAN, state))
        moments: dict[int, dict[str, torch.Tensor]] = {}
        for name, tensor in named("moment_", state).items():
            place, _, key = name.partition("_")
            moments.setdefault(int(place), {})[key] = tensor
        groups = self._descent.state_dict()["param_groups"]
        self._descent.load_state_dict({"state": moments, "param_groups": groups})


def coded(shown: torch.Tensor) -> torch.Tensor:
    """sRGB code values of what is shown; above white they go on, so that a slope leads back."""
    light = shown.clamp(min=0) ** EXPONENT
    steep = 1.055 * light.clamp(min=0.0031308) ** (1 / 2.4) - 0.055
    return torch.where(light <= 0.0031308, 12.92 * light, steep)


def _side(draw: np.random.Generator, whole: int, side: int) -> tuple[slice, slice]:
    """Where a patch lies, its ends at those of the picture more often than chance has it, and what of it counts."""
    length = min(whole, side)
    start = min(max(int(draw.integers(-length // 4, whole - length + length // 4 + 1)), 0), whole - length)
    unsure = min(_UNSURE, length // 4)
    counts = slice(unsure if start else 0, length - (unsure if start + length < whole else 0))
    return slice(start, start + length), counts


def named(start: str, state: Mapping[str, NDArray[np.generic]]) -> dict[str, torch.Tensor]:
    """Tensors of a state whose names begin so, without that."""
    return {
        name.removeprefix(start): torch.from_numpy(array) for name, array in state.items() if name.startswith(start)
    }


def device_of(asked: str) -> str:
    """The device of torch that is asked for; "auto" is CUDA where there is any."""
    there = torch.cuda.is_available()
    chosen = ("cuda" if there else "cpu") if asked == "auto" else asked
    if chosen not in ("cpu", "cuda") or (chosen == "cuda" and not there):
        raise JobError("MF105", f"there is no device {asked!r} here", where="device", cure="Use cpu")
    return chosen


_KIND = "maskfab learned restorer 1"
_PROBED = (32, 32)
_ALIKE = 1e-3
"""Most that the transfer of the same die differs, by rounding."""
_WIDEST, _DEEPEST = 512, 8
_USE = "Train one for this job with maskfab learn, or give the one that was"
_GO_ON = "Give the settings it was trained with, add --force to train anew, or choose another --out"
ROW = ("minutes", "step", "loss", "gain", "gain_over_filter")
"""Numbers of a history: time and steps from the beginning, loss, gains over both pictures that are shown, dB."""


@dataclass(frozen=True, eq=False)
class Trade:
    """The die, camera and light that a network is trained behind; ``transfer`` is H at some frequencies."""

    job: str
    digest: str
    die: str
    camera: str
    sensor: str
    light: str
    levels: tuple[float, ...]
    images: tuple[str, ...]
    transfer: Transfer

    def require(self, other: Trade, where: str, cure: str = _USE) -> None:
        """Refuse a checkpoint for another die, camera, sensor or light; some of its levels may be asked for."""
        for what in ("die", "camera", "sensor", "light"):
            own, wanted = getattr(self, what), getattr(other, what)
            if own != wanted:
                raise another(f"{what} {own}", wanted, where, cure)
        if not set(other.levels) <= set(self.levels):
            raise another(f"light of {_decibels(self.levels)}", _decibels(other.levels), where, cure)
        if float(abs(self.transfer - other.transfer).max()) > _ALIKE:
            raise another(f"a die {self.die} of other openings, layout or scene", f"that of {other.job}", where, cure)


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A network, and where its training stands; ``history`` has a row of :data:`ROW` each time scenes judged it."""

    trade: Trade
    course: Course
    view: View
    seconds: float
    history: Sequence[Mapping[str, float]]
    state: Arrays

    def require(self, trade: Trade, seed: int, where: str) -> None:
        """Refuse to train it further for anything else, or with other levels, photographs or seed."""
        own = self.trade
        own.require(trade, where, _GO_ON)
        if set(own.levels) != set(trade.levels):
            raise another(f"light of {_decibels(own.levels)}", _decibels(trade.levels), where, _GO_ON)
        if own.images != trade.images:
            raise another(f"{len(own.images)} photographs", f"{len(trade.images)} others", where, _GO_ON)
        if self.course.seed != seed:
            raise another(f"seed {self.course.seed}", f"seed {seed}", where, _GO_ON)

    def restorer(self) -> Learned:
        """The network as a restorer."""
        network = Network(PLANES, self.course.widths)
        network.load_state_dict(named(MEAN, self.state))
        return Learned(network.eval(), self.view)

    def about(self) -> dict[str, Any]:
        """Everything but weights and transfer, as data."""
        facts = asdict(self.trade)
        del facts["transfer"]
        return {
            "maskfab": __version__,
            **facts,
            "course": asdict(self.course),
            "strengths": sorted(self.view.strengths.items()),
            "seconds": self.seconds,
            "history": [dict(entry) for entry in self.history],
        }

    def write(self, path: Path) -> None:
        """Keep it in a file, aside first and renamed. Raises OutputError MF401 if it cannot be written."""
        about = np.array(json.dumps(self.about()))
        save_state(path, _KIND, {"about": about, "transfer": self.trade.transfer, **self.state})

    @classmethod
    def read(cls, path: Path) -> Checkpoint:
        """Of a file, of which no code is run; MF301 without one, MF303 if it is damaged, MF304 if of another kind."""
        if not os.path.isfile(path):
            raise SourceError("MF301", no_file(path, path), cure="Train one with maskfab learn")
        state = read_state(path)
        if str(state.pop(RUN, "")) != _KIND:
            what = "the file is no checkpoint of maskfab learn"
            raise SourceError("MF304", what, where=str(path), cure="Train one with it")
        try:
            read = cls._of(state)
            read.restorer()
        except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:
            what = "the checkpoint is damaged"
            raise SourceError("MF303", what, where=str(path), cure="Delete it and train again") from error
        return read

    @classmethod
    def _of(cls, state: dict[str, NDArray[np.generic]]) -> Checkpoint:
        about = json.loads(str(state.pop("about")))
        texts = {key: str(about[key]) for key in ("job", "digest", "die", "camera", "sensor", "light")}
        levels, images = tuple(map(float, about["levels"])), tuple(map(str, about["images"]))
        trade = Trade(**texts, levels=levels, images=images, transfer=np.asarray(state["transfer"]))
        settings = about["course"]
        course = Course(**(settings | {key: tuple(settings[key]) for key in ("widths", "patch")}))
        view = View({float(electrons): float(epsilon) for electrons, epsilon in about["strengths"]})
        history = tuple({key: float(row[key]) for key in ROW} for row in about["history"])
        read = cls(trade, course, view, float(about["seconds"]), history, state)
        read._check()
        del state["transfer"]
        return read

    def _check(self) -> None:
        """Raise a ValueError for what no training leaves."""
        widths, strengths = self.course.widths, [*self.view.strengths, *self.view.strengths.values()]
        finite = all(np.isfinite(array).all() for array in self.state.values() if array.dtype.kind in "fc")
        small = 0 < len(widths) <= _DEEPEST and max(widths) <= _WIDEST
        rows, columns = _PROBED
        probed = self.trade.transfer.shape == (COLOURS, rows, columns // 2 + 1)
        if not (finite and small and probed and strengths and min(strengths) > 0):
            raise ValueError(self.about())


def probe(blur: Blur) -> Transfer:
    """H at the frequencies by which dies are told apart."""
    return blur.on(_PROBED)


def another(own: str, wanted: str, where: str, cure: str = _USE) -> JobError:
    """The refusal of a checkpoint for something else."""
    what = f"the checkpoint was trained for {own}; asked for is {wanted}"
    return JobError("MF148", what, where=where, cure=cure)


def _decibels(levels: Sequence[float]) -> str:
    return ", ".join(f"{level:g} dB" for level in levels)


_WARMED = 2


def step_seconds(course: Course, device: str) -> float:
    """Seconds of a step, once it is warm, by steps on nothing."""
    sides = course.patch
    blank = Lesson(np.zeros((PLANES, *sides), dtype=np.float32), np.zeros((COLOURS, *sides), dtype=np.float32))
    training = Training(course, lambda _: blank, device)
    for _ in range(_WARMED):
        begun = time.monotonic()
        training.advance()
    return time.monotonic() - begun


LOOKS = 10
"""Times that a run judges and keeps what it has."""

SET_UP = "the scenes that training is judged by"
FEWEST = 120
"""Steps that gain a tenth of a decibel over total variation behind a periodic display; fewer are not worth training."""


@dataclass
class Run:
    """A training, and how it went so far.

    Attributes:
        clock: of the budget, from the beginning of the command's work.
        fewest: steps in all that are worth their time; fewer are refused by a clock that refuses.
    """

    path: Path
    trade: Trade
    design: Design
    training: Training
    view: View
    scenes: Sequence[Lesson]
    history: list[Mapping[str, float]] = field(default_factory=list)
    clock: Clock = field(default_factory=Clock)
    earlier_s: float = 0.0
    fewest: int = FEWEST

    @classmethod
    def of(
        cls,
        path: Path,
        trade: Trade,
        protocol: Protocol,
        design: Design,
        photographs: Sequence[Photograph],
        *,
        course: Course,
        device: str,
        before: Checkpoint | None,
        clock: Clock,
        progress: Progress,
    ) -> Run:
        """One that begins, or goes on from a checkpoint."""
        levels = trade.levels
        # What is to come takes no less than what made the die ready, and then the fewest steps.
        step = step_seconds(course, device)
        steps = max(0, FEWEST - (int(before.state["step"]) if before else 0))
        what, steps_s = f"{SET_UP}, and {steps} steps of {step:.2g} s,", steps * step
        clock.require(clock.spent + steps_s, what, "minutes")
        held_back, others = kept_for_validation(photographs, max(2, len(levels)), lamps=bool(protocol.brackets))
        progress("scenes to judge by", 0, len(held_back))
        view = before.view if before else fitted(protocol, design, levels, held_back, clock, what, steps_s)
        lessons = Lessons(protocol, design, levels, view, others, course.seed)
        scenes = []
        begun = clock.spent
        for done, scene in enumerate(held_back, start=1):
            scenes.append(lessons.of(scene, levels[(done - 1) % len(levels)]))
            progress("scenes to judge by", done, len(held_back))
            clock.require((clock.spent - begun) / done * (len(held_back) - done) + steps_s, what, "minutes")
        made = cls(path, trade, design, Training(course, lessons, device), view, scenes, clock=clock)
        if before is not None:
            made.training.restore(before.state)
            made.history.extend(before.history)
            made.earlier_s = before.seconds
        return made

    def trained(self, progress: Progress) -> Checkpoint:
        """Train as long as the budget, one step at least; the last look, which takes as long as one before, is in it.

        Raises:
            JobError: MF150 for a clock that refuses, if the first step shows that it holds fewer than are useful.
            OutputError: MF401 if the checkpoint cannot be written.
        """
        seconds = math.inf if self.clock.budget_s is None else self.clock.budget_s
        losses, looks, step, look = list[float](), 0, 0.0, 0.0
        self.training.get_ready()
        while True:
            begun = self.clock.spent
            losses.append(self.training.advance())
            spent = self.clock.spent
            step = max(step, spent - begun)
            if not look:
                wanting = max(0, self.fewest - self.training.step)
                held = 1 + max(0, int((min(seconds, 1e9) - spent) / step))
                what = f"{SET_UP}, and {self.fewest} steps of {step:.2g} s, of which it holds {held},"
                self.clock.require(wanting * step, what, "minutes")
            over = spent + step + look >= seconds
            # The first look tells how long the last one takes.
            if over or not look or spent / seconds >= (looks + 1) / LOOKS:
                looks = int(spent / seconds * LOOKS)
                checkpoint = self._kept(float(np.mean(losses)))
                look = max(look, self.clock.spent - spent, 1e-9)
                over = over or self.clock.spent + step + look > seconds
                losses.clear()
                progress(row_words(self.history[-1]), LOOKS if over else looks, LOOKS)
                if over:
                    return checkpoint

    def _kept(self, loss: float) -> Checkpoint:
        seconds = self.earlier_s + self.clock.spent
        self.history.append({"minutes": seconds / 60, "step": self.training.step, "loss": loss, **self.gains()})
        training = self.training
        checkpoint = Checkpoint(self.trade, training.course, self.view, seconds, tuple(self.history), training.state())
        checkpoint.write(self.path)
        return checkpoint

    def gains(self) -> dict[str, float]:
        """Mean gains over both pictures that are shown, dB, on scenes that are not taught."""
        restorer, rows = Learned(self.training.mean, self.view), []
        for scene in self.scenes:
            pictures = scene.shown[:COLOURS], scene.shown[COLOURS : 2 * COLOURS]
            before = [psnr(code_of_light(light_of(picture)), scene.true) for picture in pictures]
            now = psnr(code_of_light(restorer.restored(scene.shown, self.design)), scene.true)
            rows.append([now - score for score in before])
        over_tv, over_filter = np.mean(rows, axis=0)
        return {"gain": float(over_tv), "gain_over_filter": float(over_filter)}


def row_words(row: Mapping[str, float]) -> str:
    """A row of a history in words."""
    gains = f"{row['gain']:+.2f} dB over tv, {row['gain_over_filter']:+.2f} dB over dct+wiener"
    return f"{row['step']:.0f} steps, loss {row['loss']:.3f}, {gains}"


def fitted(
    protocol: Protocol,
    design: Design,
    levels: Sequence[float],
    scenes: Sequence[Photograph],
    clock: Clock,
    what: str,
    then_s: float,
) -> View:
    """The view whose second picture suits the scenes best, on average at every level.

    Args:
        what: of the clock's refusal, takes what is left and so many seconds more.
    """
    strengths, begun = {}, clock.spent
    for done, level in enumerate(levels, start=1):
        table = evaluate([design], scenes, scenes, [level], protocol=protocol, restorers=(Dct(),), details=False)
        strengths[protocol.exposure(level).behind(design.transmission)] = table.scores[0].epsilon
        clock.require((clock.spent - begun) / done * (len(levels) - done) + then_s, what, "minutes")
    return View(strengths)
