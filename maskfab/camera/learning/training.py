"""Training of a network on lessons, step by step, so that it can be cut off anywhere and go on to the same result.

A step descends (Kingma, Ba, Adam, ICLR 2015) on the squared error of a few patches, as it is scored, over that of the
whole picture that is mended, so that dim scenes count as much as bright ones. What is used is the mean of the weights
over the last steps (Polyak, Juditsky, SIAM J. Control Optim. 30, 838, 1992), which is good whenever training stops.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.base.arrays import Singles
from maskfab.camera.learning.lessons import Lesson
from maskfab.camera.learning.network import COLOURS, Network
from maskfab.camera.learning.view import EXPONENT, PLANES
from maskfab.errors import JobError
from maskfab.optics.numbers.colour import code_of_light

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
        seed: of weights and patches.
        widths: of the network.
        rate: of the descent.
        patch: rows and columns, at most those of a lesson.
        patches: of a step.
        first: lessons to begin with.
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
    """A network on its way.

    Args:
        course: that it takes.
        lesson: by number.
        device: of torch.
    """

    def __init__(self, course: Course, lesson: Callable[[int], Lesson], device: str = "cpu") -> None:
        self.course, self.device, self.step = course, torch.device(device), 0
        self._lesson = lesson
        self._known: dict[int, tuple[Lesson, float]] = {}
        # Weights follow from the seed alone, and nobody else's draws change.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(course.seed)
            self.network, self.mean = (self._made() for _ in range(2))
        self.mean.load_state_dict(self.network.state_dict())
        self._descent = torch.optim.Adam(self.network.parameters(), lr=course.rate, betas=(0.9, 0.99))

    def _made(self) -> Network:
        return Network(PLANES, self.course.widths).to(self.device)

    def advance(self) -> float:
        """One step; the loss before it, 1 for the picture that is mended."""
        course = self.course
        shown, true, weight = (torch.from_numpy(each).to(self.device) for each in self._patches())
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

    def _patches(self) -> tuple[Singles, Singles, Singles]:
        """Planes that are shown, the truth, and the weight of every pixel, each [patches, planes, rows, columns]."""
        newest = self.course.first + self.step // self.course.fresh
        numbers = range(max(0, newest - self.course.known), newest)
        for number in [each for each in self._known if each not in numbers]:
            del self._known[number]
        for number in numbers:
            if number not in self._known:
                lesson = self._lesson(number)
                error = np.square(_code(lesson.shown[:COLOURS]) - lesson.true).mean(dtype=np.float64)
                self._known[number] = lesson, float(error)
        draw = np.random.default_rng([self.course.seed, self.step])
        cut = [self._patch(draw, *self._known[int(draw.choice(numbers))]) for _ in range(self.course.patches)]
        shown, true, weight = (np.stack(each) for each in zip(*cut, strict=True))
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
        tensors = {f"now_{name}": each for name, each in self.network.state_dict().items()}
        tensors |= {f"{MEAN}{name}": each for name, each in self.mean.state_dict().items()}
        for place, moments in self._descent.state_dict()["state"].items():
            tensors |= {f"moment_{place}_{name}": each for name, each in moments.items()}
        return {"step": np.array(self.step), **{name: each.cpu().numpy().copy() for name, each in tensors.items()}}

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


def _code(shown: Singles) -> Singles:
    return code_of_light(np.maximum(shown, 0) ** np.float32(EXPONENT))


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
    """The device of torch that is asked for; "auto" is CUDA where there is any.

    Raises:
        JobError: MF105 for one that is not there.
    """
    there = torch.cuda.is_available()
    chosen = ("cuda" if there else "cpu") if asked == "auto" else asked
    if chosen not in ("cpu", "cuda") or (chosen == "cuda" and not there):
        raise JobError("MF105", f"there is no device {asked!r} here", where="device", cure="Use cpu")
    return chosen
