r"""Openings with a large area under the radial minimum of the MTF, by exchanging one clear dot for a closed one.

The area is that of :class:`maskfab.designs.model.limits.Rings`: of the modulation expected of cells turned at
random, or of the repeated unit. A minimum has no slope to follow, so both searches follow a smoothed one, always to the
best neighbour even if it is worse, and do not touch the exchanged dots for some steps (Glover, ORSA J. Computing 1,
190, 1989). The best unit by the true minimum counts.

* Repeated: M(t) is a count of pairs, and with N_p the pairs that dot p makes at every lag, the smoothed minimum of all
  exchanges of a for b,

      sum over lags of  v exp(-(count - N_a + N_b) / τ),

  is a product of a matrix over a and one over b, exactly, but for the one lag b - a whose pair is counted in N_b though
  a has gone. So a step sees every exchange. v is the share of the rings that have the lag.
* Turned at random: the slope of -τ log sum exp(-M / τ), summed over the rings, ranks the exchanges, and the best are
  judged exactly.

Notes:
    What a laid panel shows is less than what is expected of it: each ring's minimum takes the worst of many lags, and
    each lag scatters around its expectation. A compact opening of 100 of 441 dots that reaches 0.180 of at most 0.183
    measures 0.165 in 24 x 24 cells. With ``scatter`` the minimum is taken over the expectation less so many standard
    deviations; 1.6 predicts what a panel shows, and leads to openings that are less compact: 0.174, and 0.167 measured.
    Repeated, 0.150 of at most 0.168.
    Areas are over whole lags, of the pupil's autocorrelation times the pixel's sinc: an open stop has 0.722. The
    published code adds up its PSF's samples off the pixel's middle, which costs everything 9 % (0.659).
    Half a ring may be ruined for its lowest point: such openings are not good for pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Mask
from maskfab.base.errors import JobError
from maskfab.base.model import ORIENTATIONS, orient
from maskfab.base.work import Progress, silent
from maskfab.camera.lens import CellGrid, lattice
from maskfab.designs.model.limits import Rings, rings
from maskfab.mask.opening_masks import require_clear_dots

STEPS = 2000, 400
"""Exchanges of a repeated unit, and of one turned at random: of 21 dots some 3 s and 7 s on one core."""

# Counts of pairs: from neighbours that hardly differ to the minimum itself.
_HOT, _COLD = 1.5, 0.6
_TEMPERATURE = 0.002  # of the modulation
_LONGEST_AWAY = 12  # steps for which an exchanged dot is left alone; then up to as many more, by chance
_SHORTLIST = 6  # dots of either kind whose exchanges are ranked
_JUDGED = 12
_TOLD_EVERY = 20


def best_for_auc(
    dots: int = 21,
    clear_dots: int = 100,
    *,
    periodic: bool = False,
    seed: int = 0,
    steps: int | None = None,
    scatter: float = 0.0,
    room: CellGrid | None = None,
    progress: Progress = silent,
) -> Mask:
    """A unit whose blue area under the radial minimum of the MTF is large, bool [dots, dots].

    Its area is ``rings(dots, room=room).of_unit(unit, periodic=periodic)``, its limit
    :func:`maskfab.designs.model.limits.auc_bound`.

    Args:
        dots: along the unit's side.
        periodic: the unit is repeated; otherwise turned at random.
        seed: of the start and of the chances; the same seed and steps give the same unit.
        steps: exchanges, the whole budget; None takes :data:`STEPS`.
        scatter: standard deviations of one panel of 24 x 24 cells by which its modulation may fall short of what is
            expected; units turned at random only.
        room: of the cells behind the stop, of so many dots; None for cells of 168 um behind protocol F1's.

    Raises:
        JobError: MF104 for no dots, negative steps, or a scatter that is negative or not finite.
        OpeningError: MF203 if no dot is clear; MF204 if there are more than the unit has.
    """
    total = dots**2
    for name, value, least in (("dots", dots, 1), ("steps", steps or 0, 0), ("scatter", scatter, 0)):
        if not least <= value < math.inf:
            raise JobError("MF104", f"{name} = {value}", where=f"design.{name}", cure=f"Give {least} or more")
    require_clear_dots(clear_dots, total)
    draw = np.random.default_rng(seed)
    if clear_dots == total:
        return np.ones((dots, dots), dtype=np.bool_)
    wanted = STEPS[0 if periodic else 1] if steps is None else steps
    room = room or lattice(dots)
    around = rings(dots, room=room)
    if periodic:
        return _search_repeated(around, clear_dots, draw, wanted, progress)
    return _search_turned(Smoothed.of(around, scatter, room), clear_dots, draw, wanted, progress)


@dataclass(frozen=True, eq=False)
class DotPairs:
    """Pairs of clear dots of a repeated unit, by their difference; opposite differences are one.

    Attributes:
        kind: int64 [n², n²], number of the difference of any two dots; 0 is no difference.
        repeats: int64 [kinds], 2 where a difference is its own opposite, else 1.
        faintest: [rings, kinds], least transfer of the open stop at such lags of a ring; inf where there is none.
    """

    kind: NDArray[np.int64]
    repeats: NDArray[np.int64]
    faintest: Floats

    @classmethod
    def of(cls, around: Rings) -> DotPairs:
        """Pairs for the rings of a camera."""
        n = around.dots
        y, x = np.divmod(np.arange(n * n), n)
        opposite = (-y % n) * n + -x % n
        heads, numbers = np.unique(np.minimum(np.arange(n * n), opposite), return_inverse=True)
        kinds = numbers.reshape(n, n)
        faintest = np.full((around.count, len(heads)), np.inf)
        v, u = around.lags
        for down, right in [(v, u), (-v, u), (u, v), (-u, v)]:
            np.minimum.at(faintest, (around.ring, kinds[down % n, right % n]), around.clear)
        repeats = 1 + (opposite[heads] == heads)
        return cls(kinds[(y[:, None] - y) % n, (x[:, None] - x) % n], repeats, faintest)

    def made_with(self, dot: int) -> NDArray[np.int8]:
        """[n²], ordered pairs that every dot makes with this one, at its kind of difference; none with itself."""
        made = self.repeats[self.kind[:, dot]].astype(np.int8)
        made[dot] = 0
        return made


def _search_repeated(around: Rings, clear: int, draw: np.random.Generator, steps: int, progress: Progress) -> Mask:
    n = around.dots
    pairs = DotPairs.of(around)
    seen = np.isfinite(pairs.faintest)
    faintest = np.where(seen, pairs.faintest, np.finfo(np.float64).max / (clear + 1))
    share = seen.mean(axis=0)
    share[0] = 0
    every = np.arange(n * n)
    unit = np.zeros(n * n, dtype=np.bool_)
    unit[draw.permutation(n * n)[:clear]] = True
    # N: ordered pairs of each dot, clear or not, with the clear ones.
    made = np.zeros((n * n, len(share)), dtype=np.int8)
    for dot in np.flatnonzero(unit):
        made[every, pairs.kind[:, dot]] += pairs.made_with(int(dot))
    count = made[unit].sum(axis=0, dtype=np.int64) / 2
    count[0] = clear

    def area() -> float:
        return float((faintest * count).min(axis=1).mean() / clear)

    best, best_area = unit.copy(), area()
    free, away = np.zeros(n * n, dtype=np.int64), _away(clear, n * n)
    for step in range(steps):
        heat = _HOT * (_COLD / _HOT) ** (step / steps)
        clear_dots, closed = np.flatnonzero(unit & (free <= step)), np.flatnonzero(~unit & (free <= step))
        if not (len(clear_dots) and len(closed)):
            continue
        present = share * np.exp((count[1:].min() - count) / heat)
        factor = np.exp(np.arange(3) / heat)
        without = (present * factor[made[clear_dots]]).astype(np.float32)
        with_it = (1 / factor)[made[closed]].astype(np.float32)
        between = pairs.kind[np.ix_(clear_dots, closed)]
        twice = np.take_along_axis(without, between, 1) * np.take_along_axis(with_it, between.T, 1).T
        loss = without @ with_it.T + twice * (factor[pairs.repeats] - 1).astype(np.float32)[between]
        out, into = (int(v) for v in np.unravel_index(int(loss.argmin()), loss.shape))
        out, into = int(clear_dots[out]), int(closed[into])
        count -= made[out]
        made[every, pairs.kind[:, out]] -= pairs.made_with(out)
        count += made[into]
        made[every, pairs.kind[:, into]] += pairs.made_with(into)
        unit[out], unit[into] = False, True
        free[[out, into]] = step + 1 + away + draw.integers(away, size=2)
        if (reached := area()) > best_area:
            best, best_area = unit.copy(), reached
        if (step + 1) % _TOLD_EVERY == 0:
            progress(f"exchange, area {best_area:.4f}", step + 1, steps)
    return best.reshape(n, n)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The area of units turned at random, less the scatter of a panel if asked for; with slopes.

    Attributes:
        dots: along the unit's side.
        scatter: standard deviations that are taken off.
        cells: in the stop.
        turned: int64 [8, n, n], which dot stands where, oriented.
        lags: int64 [2, m], as those of :class:`maskfab.designs.model.limits.Rings`.
        short: bool [m], shorter than a cell along both axes.
        clear: [m], the open stop's transfer.
        deviation: [m], of the transfer times clear dots, if one cell's pairs have a variance of one.
        order: int64 [rings, longest], the lags ring by ring, filled up to equal length.
        filled: bool, the same shape, places that are no lag.
    """

    dots: int
    scatter: float
    cells: float
    turned: torch.Tensor
    lags: torch.Tensor
    short: torch.Tensor
    clear: torch.Tensor
    deviation: torch.Tensor
    order: torch.Tensor
    filled: torch.Tensor

    @classmethod
    def of(cls, around: Rings, scatter: float, room: CellGrid | None = None) -> Smoothed:
        """The area for the rings of a camera, behind the same cells as these; None for cells of 168 um."""
        n = around.dots
        room = room or lattice(n)
        index = np.arange(n * n).reshape(n, n)
        cells = float(room.stop.sum()) / n**2
        number = np.bincount(around.ring)
        first = np.cumsum(number) - number
        place = np.arange(number.max())
        filled = place >= number[:, None]
        order = np.argsort(around.ring, kind="stable")[np.where(filled, first[:, None], first[:, None] + place)]
        per_cycle = room.per_cycle(room.camera.shortest_nm)
        pixel = np.prod(np.sinc(around.lags / per_cycle), axis=0)
        return cls(
            n,
            scatter,
            cells,
            torch.from_numpy(np.stack([orient(index, k) for k in range(ORIENTATIONS)])),
            torch.from_numpy(around.lags),
            torch.from_numpy(around.lags.max(axis=0) < n),
            torch.from_numpy(around.clear),
            torch.from_numpy(np.sqrt(around.clear * pixel / cells)),
            torch.from_numpy(order),
            torch.from_numpy(filled),
        )

    def __call__(self, unit: torch.Tensor, temperature: float = 0.0) -> torch.Tensor:
        """The area of a unit [n, n] of dots from 0 to 1; smoothed if the temperature is above 0."""
        values = self._lowered(unit)[self.order]
        if temperature == 0:
            return values.masked_fill(self.filled, torch.inf).amin(1).mean()
        cold = (-values / temperature).masked_fill(self.filled, -torch.inf)
        return -temperature * torch.logsumexp(cold, dim=1).mean()

    def of_mask(self, unit: Mask, temperature: float = 0.0) -> float:
        """The objective of a mask."""
        with torch.no_grad():
            return float(self(torch.from_numpy(unit.astype(np.float64)), temperature))

    def slope(self, unit: Mask) -> Floats:
        """Slope of the smoothed area by every dot, [n²]."""
        leaf = torch.from_numpy(unit.astype(np.float64)).requires_grad_()
        (slope,) = torch.autograd.grad(self(leaf, _TEMPERATURE), leaf)
        return np.asarray(slope.numpy().ravel())

    def _lowered(self, unit: torch.Tensor) -> torch.Tensor:
        """Expected modulation at the lags, as that of :func:`maskfab.designs.model.expected_psnr.unit_modulation`."""
        n, clear = self.dots, unit.sum()
        y, x = self.lags
        turned = unit.flatten()[self.turned]
        wide = torch.fft.rfft2(turned, s=(2 * n, 2 * n))
        spread = (wide.abs() ** 2).mean(0) - wide.mean(0).abs() ** 2
        linear = torch.fft.irfft2(spread, s=(2 * n, 2 * n)) / clear
        circular = torch.fft.irfft2(torch.fft.rfft2(turned.mean(0)).abs() ** 2, s=(n, n)) / clear
        near = torch.where(self.short, linear[y % (2 * n), x % (2 * n)], 0)
        expected: torch.Tensor = self.clear * (circular[y % n, x % n] + near)
        if self.scatter == 0:
            return expected
        long, short = self._variance(wide)
        variance = torch.where(self.short, short[y % n, x % n], long[y % n, x % n])
        # Lag 0 does not scatter; the root has no slope there.
        deviation = self.deviation * torch.sqrt(variance + 1e-12 * clear**2) / clear
        lowered: torch.Tensor = expected - self.scatter * deviation
        return lowered

    def _variance(self, wide: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Variance of one cell's pairs with the cells that a lag reaches, at long lags and short ones, modulo n [n, n].

        A lag reaches parts of four cells. What depends on one cell's orientation alone adds up over the four, what
        depends on two cells' is independent (Efron & Stein, Ann. Statist. 9, 586, 1981). At short lags one of the four
        is the cell itself.
        """
        n = self.dots
        products = torch.fft.irfft2(wide[:, None].conj() * wide, s=(2 * n, 2 * n))
        parts = products.view(ORIENTATIONS, ORIENTATIONS, 2, n, 2, n).permute(2, 4, 0, 1, 3, 5).flatten(0, 1)
        first, second, mean = parts.mean(2), parts.mean(1), parts.mean((1, 2))
        both = parts - first[:, :, None] - second[:, None] + mean[:, None, None]
        between = (both**2).mean((1, 2))
        single = first + second
        itself = parts[0].diagonal(dim1=0, dim2=1).permute(2, 0, 1)
        long = between.sum(0) + single.sum(0).var(0, correction=0)
        return long, between[1:].sum(0) + (single[1:].sum(0) + itself).var(0, correction=0)


def _search_turned(area: Smoothed, clear: int, draw: np.random.Generator, steps: int, progress: Progress) -> Mask:
    n = area.dots
    unit: Mask = np.zeros((n, n), dtype=np.bool_)
    unit.flat[draw.permutation(n * n)[:clear]] = True
    best, best_area = unit, area.of_mask(unit)
    free, away = np.zeros(n * n, dtype=np.int64), _away(clear, n * n)
    for step in range(steps):
        slope = area.slope(unit)
        clear_dots = np.flatnonzero(unit.ravel() & (free <= step))
        closed = np.flatnonzero(~unit.ravel() & (free <= step))
        clear_dots = clear_dots[np.argsort(slope[clear_dots], kind="stable")[:_SHORTLIST]]
        closed = closed[np.argsort(-slope[closed], kind="stable")[:_SHORTLIST]]
        if not (len(clear_dots) and len(closed)):
            continue
        gain = slope[closed] - slope[clear_dots][:, None]
        judged = []
        for place in np.argsort(-gain, axis=None, kind="stable")[:_JUDGED]:
            row, column = divmod(int(place), len(closed))
            changed = [int(clear_dots[row]), int(closed[column])]
            trial = unit.copy()
            trial.flat[changed] = [False, True]
            judged.append((area.of_mask(trial, _TEMPERATURE), trial, changed))
        _, unit, changed = max(judged, key=lambda trial: trial[0])
        free[changed] = step + 1 + away + draw.integers(away, size=2)
        if (reached := area.of_mask(unit)) > best_area:
            best, best_area = unit, reached
        if (step + 1) % _TOLD_EVERY == 0:
            progress(f"exchange, area {best_area:.4f}", step + 1, steps)
    return best


def _away(clear: int, total: int) -> int:
    """At least 1; few enough that of either kind of dots some are free."""
    return min(_LONGEST_AWAY, 1 + min(clear, total - clear) // 6)
