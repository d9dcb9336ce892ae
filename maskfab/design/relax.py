"""A good opening by gradient descent on relaxed dots, then on real ones.

Every dot is a number mapped to a transmission by a sigmoid; Adam follows the gradient of the loss through the
tiled pupil, an area penalty leads the open ratio down from one to its target, and the sigmoid's gain grows until
the transmissions are nearly binary. The largest ones become clear dots, exactly as many as asked for, and pairs of
dots are exchanged as long as that helps. Every candidate is judged after binarisation, because a relaxed loss
flatters grey.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from maskfab import __version__
from maskfab.design.descent import Descent, RelaxStep, binarised, descend
from maskfab.design.losses import Invertibility, cells_across, invertibility
from maskfab.design.objective import AreaPenalty
from maskfab.errors import JobError, OpeningError
from maskfab.layout.tiling import orientations
from maskfab.model import Opening, Stop, Tiling
from maskfab.spec import check_name
from maskfab.units import parse_wavelength_nm

__all__ = ["RelaxSettings", "RelaxStep", "binarised", "descent_of", "loss_of", "optimise"]

LEARNING_RATE = 0.2
START_LOGIT = 1.0  # 0.73 open: "all open" as the paper's authors ran it ...
START_NOISE = 0.5  # ... but an even start is an exact saddle, where every dot of an orbit has the same gradient
AREA_WEIGHT = 400.0  # holds the relaxed open ratio within 0.006 of its target against the pull of the loss
AREA_SETTLED = 0.4  # share of the iterations after which the area's target is the final one
FINAL_GAIN = 10.0  # nearly binary, and the gradient is still alive
JUDGED_EVERY = 10
SWAPS_TRIED = 64  # pairs verified before the polish gives up
SWAP_ROUNDS = 300


@dataclass(frozen=True)
class RelaxSettings:
    """What to design, and for which camera.

    Attributes:
        name: of the opening.
        dots: dots along the cell's side.
        dot_nm: side of one dot.
        open_ratio: share of the dots to be clear; the nearest count is met exactly.
        tiling: how the cells are oriented while the opening is judged.
        tiling_seed: seed of a random tiling; None if periodic.
        focal_um: focal length.
        stop: lens aperture, filled with cells.
        wavelengths_nm: lines; each counts equally.
        pixel_um: side of a sensor pixel; frequencies up to half a cycle per pixel count.
        seed: seed of the start.
        iterations: gradient steps.
        epsilon: noise-to-signal ratio of the Wiener filter.
        worst_fraction: share of the spatial frequencies that counts, the worst ones.
        command: how a user repeats this run; goes into the provenance.
    """

    name: str
    dots: int
    dot_nm: int
    open_ratio: float
    tiling: Tiling
    tiling_seed: int | None
    focal_um: float
    stop: Stop
    wavelengths_nm: tuple[float, ...]
    pixel_um: float
    seed: int = 0
    iterations: int = 300
    epsilon: float = 0.015
    worst_fraction: float = 0.3
    command: str = ""


def optimise(settings: RelaxSettings, progress: Callable[[RelaxStep], None] | None = None) -> Opening:
    """The best binary opening found; the same settings give the same one on the same machine.

    The provenance holds the loss reached, ``loss``.

    Raises:
        JobError: MF104 for a number out of its range, MF110 a refused name, MF111 no seed for a random tiling,
            MF112 to MF115 what the camera cannot be.
        OpeningError: MF203 for an open ratio of zero, MF204 for one that no count of dots comes near.
        InternalError: MF901 if the loss is not finite.
    """
    _check(settings)
    clear_dots = _clear_dots(settings.open_ratio, settings.dots)
    loss = loss_of(settings)
    target = clear_dots / settings.dots**2
    found = descend(loss, AreaPenalty(target, AREA_WEIGHT, AREA_SETTLED), descent_of(settings), progress=progress)
    cell, reached = _polish(loss, found.unit, found.loss)
    provenance: dict[str, str | int | float] = {
        "author": "maskfab",
        "command": settings.command,
        "seed": settings.seed,
        "version": __version__,
        "tiling": settings.tiling.value,
        **({} if settings.tiling_seed is None else {"tiling_seed": settings.tiling_seed}),
        "loss": round(reached, 6),
    }
    return Opening(settings.name, cell.numpy() > 0.5, settings.dot_nm, provenance)


def descent_of(settings: RelaxSettings) -> Descent:
    """The schedule that :func:`optimise` follows."""
    return Descent(
        dots=settings.dots,
        clear_dots=_clear_dots(settings.open_ratio, settings.dots),
        iterations=settings.iterations,
        seed=settings.seed,
        rate=LEARNING_RATE,
        start_logit=START_LOGIT,
        start_noise=START_NOISE,
        final_gain=FINAL_GAIN,
        settled=AREA_SETTLED,
        judged_every=JUDGED_EVERY,
    )


def loss_of(settings: RelaxSettings) -> Invertibility:
    """The loss that :func:`optimise` minimises."""
    across = cells_across(settings.stop, settings.dots, settings.dot_nm)
    return invertibility(
        dots=settings.dots,
        dot_nm=settings.dot_nm,
        orientations=orientations(settings.tiling, across, across, settings.tiling_seed, where="design.tiling_seed"),
        stop=settings.stop,
        focal_um=settings.focal_um,
        wavelengths_nm=settings.wavelengths_nm,
        pixel_um=settings.pixel_um,
        target=_clear_dots(settings.open_ratio, settings.dots) / settings.dots**2,
        epsilon=settings.epsilon,
        worst_fraction=settings.worst_fraction,
    )


def _polish(loss: Invertibility, cell: torch.Tensor, reached: float) -> tuple[torch.Tensor, float]:
    """Exchange a clear and an opaque dot while that lowers the loss; the gradient says which pairs to try first."""
    for _ in range(SWAP_ROUNDS):
        for closed, opened in _promising_swaps(loss, cell):
            candidate = cell.clone()
            candidate.view(-1)[closed], candidate.view(-1)[opened] = 0, 1
            candidate_loss = _judge(loss, candidate)
            if candidate_loss < reached:
                cell, reached = candidate, candidate_loss
                break
        else:
            break
    return cell, reached


def _promising_swaps(loss: Invertibility, cell: torch.Tensor) -> list[tuple[int, int]]:
    """Pairs (dot to close, dot to open), the steepest descent first."""
    trial = cell.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(loss(trial), trial)
    slope, clear = gradient.flatten().numpy(), cell.flatten().numpy() > 0.5
    width = math.ceil(math.sqrt(SWAPS_TRIED)) * 2
    to_close = np.flatnonzero(clear)[np.argsort(-slope[clear], kind="stable")[:width]]
    to_open = np.flatnonzero(~clear)[np.argsort(slope[~clear], kind="stable")[:width]]
    change = slope[to_open][None, :] - slope[to_close][:, None]
    order = np.argsort(change, axis=None, kind="stable")[:SWAPS_TRIED]
    return [(int(to_close[i // len(to_open)]), int(to_open[i % len(to_open)])) for i in order]


def _judge(loss: Invertibility, cell: torch.Tensor) -> float:
    with torch.no_grad():
        return float(loss(cell))


def _clear_dots(open_ratio: float, dots: int) -> int:
    total = dots * dots
    if open_ratio == 0:
        raise OpeningError(
            "MF203",
            f"an open ratio of 0 leaves 0 of {total} dots clear",
            where="design.open_ratio",
            cure=f"Set open_ratio to at least {1 / total:.4f}",
        )
    clear_dots = round(open_ratio * total) if 0 < open_ratio <= 1 else 0
    if clear_dots == 0:
        raise OpeningError(
            "MF204",
            f"open ratio {open_ratio:g} cannot be reached: {dots} x {dots} dots offer {1 / total:.4f} to 1 in steps of "
            f"{1 / total:.4f}",
            where="design.open_ratio",
            cure=f"The nearest is {1.0 if open_ratio > 1 else 1 / total:.4f}",
        )
    return clear_dots


def _check(settings: RelaxSettings) -> None:
    check_name(settings.name, where="design.name")
    limits: tuple[tuple[str, float, float, float], ...] = (
        ("dots", settings.dots, 2, 512),
        ("dot_nm", settings.dot_nm, 1, math.inf),
        ("iterations", settings.iterations, 1, 100_000),
        ("epsilon", settings.epsilon, 1e-9, 1e3),
        ("worst_fraction", settings.worst_fraction, 1e-6, 1),
        ("seed", settings.seed, 0, 2**63 - 1),
    )
    lengths: tuple[tuple[str, float, float, float], ...] = (
        ("focal", settings.focal_um, 1e-3, 1e9),
        ("pixel", settings.pixel_um, 1e-3, 1e9),
        ("stop.diameter", settings.stop.diameter_um, 1e-3, 1e9),
    )
    for section, unit, group in (("design", "", limits), ("camera", " um", lengths)):
        for key, value, low, high in group:
            if not low <= value <= high:  # also refuses NaN
                raise JobError(
                    "MF104",
                    f"{key} = {value}{unit} must lie between {low:g}{unit} and {high:g}{unit}",
                    where=f"{section}.{key}",
                    cure=f"Choose {key} in that range",
                )
    if not settings.wavelengths_nm:
        raise JobError("MF105", "no wavelength is given", where="camera.wavelengths", cure='Write ["530 nm"]')
    for wavelength in settings.wavelengths_nm:
        parse_wavelength_nm(f"{wavelength} nm", where="camera.wavelengths")
