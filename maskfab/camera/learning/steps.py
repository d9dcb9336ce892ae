"""Steps down a slope: Adam, and plain gradient descent with momentum.

torch.optim has both, but the first use of either imports torch's compiler, which takes seconds and is never asked for
anything here. Operations are in the order of torch.optim on a CPU, so that results are the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol

import torch

Moments = dict[str, torch.Tensor]
"""Kept of the steps before one, by name, for one parameter."""

_LEAST = 1e-8


class Steps(Protocol):
    """Parameters on their way down.

    Attributes:
        rate: length of a step, for slopes of one.
        state: what the next step depends on besides the parameters and their slopes, by place of the parameter.
    """

    rate: float
    state: dict[int, Moments]

    def forget(self) -> None:
        """Take the slopes off, before new ones are found."""

    def step(self) -> None:
        """One step along the slopes that the parameters hold; those without one stay."""

    def restore(self, state: Mapping[int, Moments]) -> None:
        """Go back to a state, wherever its tensors lie."""


class _Steps:
    def __init__(self, parameters: Iterable[torch.Tensor], rate: float) -> None:
        self._parameters = tuple(parameters)
        self.rate = rate
        self.state: dict[int, Moments] = {}

    def forget(self) -> None:
        for each in self._parameters:
            each.grad = None

    def restore(self, state: Mapping[int, Moments]) -> None:
        self.state = {
            place: {name: each.clone().to(self._parameters[place].device) for name, each in moments.items()}
            for place, moments in state.items()
        }

    @torch.no_grad()
    def step(self) -> None:
        for place, each in enumerate(self._parameters):
            if each.grad is not None:
                self._move(each, each.grad, self.state.setdefault(place, {}))

    def _move(self, parameter: torch.Tensor, slope: torch.Tensor, known: Moments) -> None:
        raise NotImplementedError


class Adam(_Steps):
    """Kingma & Ba, ICLR 2015, algorithm 1.

    Args:
        parameters: tensors that hold their slopes.
        rate: length of a step.
        betas: by which the means of slopes and of their squares decay.
    """

    def __init__(self, parameters: Iterable[torch.Tensor], rate: float, betas: tuple[float, float]) -> None:
        super().__init__(parameters, rate)
        self._betas = betas

    def _move(self, parameter: torch.Tensor, slope: torch.Tensor, known: Moments) -> None:
        if not known:
            known |= {
                "step": torch.tensor(0.0),
                "exp_avg": torch.zeros_like(parameter),
                "exp_avg_sq": torch.zeros_like(parameter),
            }
        known["step"] += 1
        count, (first, second) = known["step"].item(), self._betas
        known["exp_avg"].lerp_(slope, 1 - first)
        known["exp_avg_sq"].mul_(second).addcmul_(slope, slope, value=1 - second)
        spread = (known["exp_avg_sq"].sqrt() / (1 - second**count) ** 0.5).add_(_LEAST)
        parameter.addcdiv_(known["exp_avg"], spread, value=-self.rate / (1 - first**count))


class Momentum(_Steps):
    """Gradient descent whose slopes are added up, those before decaying.

    Args:
        parameters: tensors that hold their slopes.
        rate: length of a step.
        momentum: share of the sum that stays; 0 for steps along the slope alone.
    """

    def __init__(self, parameters: Iterable[torch.Tensor], rate: float, momentum: float) -> None:
        super().__init__(parameters, rate)
        self._momentum = momentum

    def _move(self, parameter: torch.Tensor, slope: torch.Tensor, known: Moments) -> None:
        if self._momentum:
            if "momentum_buffer" in known:
                slope = known["momentum_buffer"].mul_(self._momentum).add_(slope)
            else:
                known["momentum_buffer"] = slope.clone()
        parameter.add_(slope, alpha=-self.rate)
