"""Proven lower bounds on the interior error of any opening of one clear count, by Lagrangian duality.

**The theorem.** Let every cell of n x n dots hold the same c clear dots, repeated or turned at random. At lags of one
cell and more the pupil's autocorrelation is A(t) = S(t) C(t mod n), S of the open stop, C the circular autocorrelation
of the mean of the unit's orientations over its clear dots. So all lags of one residue share one number, and as pairs of
clear dots number c², the mean of C is ρ = c / n²: rearranging dots cannot raise it. Further constraints:

* 0 <= C <= 1;
* repeated: C(0) = 1, and the same C at short lags;
* turned at random: A = S Q at short lags, Q(0) = 1, 0 <= Q <= 1. Pairs within a cell number c² however it is turned, so
  the sum of Q over the (2n - 1)² short lags is that of C(t mod n), with a multiplier κ.

By symmetry under the square's eight elements the best multipliers are symmetric, so a bound by classes of residues is
one for every C.

**The dual.** E is a sum over lags of e(A(t)) (:mod:`maskfab.designs.model.expected_psnr`). For every multiplier μ of
the mean,

    min E  >=  sum over residues r of min over a of (sum over t of r of e(t, S(t) a) - μ a)  +  μ ρ n²,

whether e is convex or not (weak duality: Boyd, Vandenberghe, Convex Optimization, 5.1.3). The minimum over a is taken
at nodes, less what e can fall below its chord between them, so a bound stays one in every digit but the last few.

Notes:
    Valid for each ε on its own; the least over the protocol's ε is the bound.
    Inherits the surrogate's model: what sampling folds back is that of a grey panel, and cut cells count as whole ones.
    Layouts of one panel are bounded by :mod:`maskfab.designs.model.layouts_bound`, which counts cut cells as they are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse

from maskfab.base.arrays import Floats, Mask
from maskfab.designs.model.expected_psnr import Interior

_NODES, _FEW_NODES = 64, 24
"""At which the cost of a lag is told, and at which the ε are told apart that cannot be the best."""
_ROUNDING = 1e-12
_TOGETHER = 1024
"""Lags whose costs are held at once, so that they stay in the processor's cache."""


def least_refined(
    count: int, rough: Callable[[int, int], float], refined: Callable[[int], float], first: int = 0
) -> float:
    """The least of dear bounds on so many errors, of which few are found: cheap ones tell which cannot be it.

    Args:
        rough: a cheap bound on all errors from one place up to, not including, another.
        refined: a dearer one of the error at a place; where it is lower, the cheap one counts.
        first: where the least is looked for first.
    """
    least = refined(first)
    waiting = [(rough(*span), span) for span in ((0, first), (first + 1, count)) if span[0] < span[1]]
    while waiting and min(waiting)[0] < least:
        cheap, (low, high) = waiting.pop(waiting.index(min(waiting)))
        if high - low == 1:
            least = min(least, max(cheap, refined(low)))
        else:
            middle = (low + high) // 2
            waiting += [(rough(*span), span) for span in ((low, middle), (middle, high))]
    return least


def best_regular(inner: Interior, variance: float, low: int = 0, high: int | None = None) -> Floats:
    """R of the best filter at each lag's frequency, [m], among those that ε within the protocol's give.

    Args:
        low, high: of these ε only, up to, not including, the last.

    An R adds σ² H²/(H² + R)² + P R²/(H² + R)², least at R = σ²/P and greater the further R lies from it, so the best of
    those between the least ε's and the largest's is the nearest.
    """
    wanted = np.divide(variance, inner.power, out=np.full(len(inner.power), np.inf), where=inner.power > 0)
    within = inner.strengths[low:high]
    return np.asarray(np.clip(wanted, within[0] * inner.inverse_prior, within[-1] * inner.inverse_prior))


def wiener_cost(inner: Interior, variance: float, grey: float, most: float = 1.0) -> tuple[Floats, Floats]:
    """Part of E that lags add at values of A from 0 up, with the best filter at each frequency, below that of any ε.

    Returns:
        Nodes [k], values of A/S, and cost [m, k]: lines between these values lie nowhere above what a lag adds.
    """
    nodes = nodes_to(most, grey)
    return nodes, cost_at(nodes, inner, variance, grey, best_regular(inner, variance))


def nodes_to(most: float, grey: float, count: int = _NODES) -> Floats:
    """Values of A/S from 0 to the largest, closer near a grey panel's: a chord's error goes with the step squared."""
    return np.concatenate([[0.0], np.geomspace(min(grey, most) / 8, most, count - 1)])


def cost_at(
    nodes: Floats, inner: Interior, variance: float, grey: float, regular: Floats, lags: slice = slice(None)
) -> Floats:
    """As :func:`wiener_cost`, [lags, k], of the filters whose R at each lag's frequency are ``regular``, [m]."""
    regular, power, weight = regular[lags], inner.power[lags], inner.weight[lags]
    slope = inner.stop[lags] * inner.pixel[lags]
    h = slope[:, None] * nodes + (grey * inner.folded[lags])[:, None]
    inverse = 1 / (1 + h**2 / regular[:, None])
    squared = inverse**2
    # With u = 1 + H²/R: noise σ² (1/u - 1/u²)/R, bias P/u²; their second slopes by H/√R are at most 6/u² and 20/u³,
    # and these fall with H, so the left end of an interval bounds them. Where R = σ²/P both together are P/u, whose
    # second slope is at most 6/u².
    by_noise, by_bias = (variance * weight / regular)[:, None], (weight * power)[:, None]
    ideal = (abs(regular * power - variance) <= _ROUNDING * variance)[:, None]
    steep = np.where(ideal, 6 * by_bias, 6 * by_noise) + np.where(ideal, 0, 20 * by_bias) * inverse[:, :-1]
    curve = (slope**2 / regular)[:, None] * (np.diff(nodes) ** 2 / 8)
    return _lowered((inverse - squared) * by_noise + squared * by_bias, steep * squared[:, :-1] * curve)


def _lowered(value: Floats, dip: Floats) -> Floats:
    """Values at nodes less the most by which the function, rising at most once and then falling, dips between."""
    rise = np.diff(value, axis=1)
    level = np.abs(rise) < dip
    lowered = value.copy()
    lowered[:, :-1] -= np.where(level, np.maximum(-rise, 0), dip)
    # A node pays for the worse of its two sides only.
    np.minimum(lowered[:, 1:], value[:, 1:] - np.where(level, np.maximum(rise, 0), dip), out=lowered[:, 1:])
    return lowered


@dataclass(frozen=True, eq=False)
class Residues:
    """Classes of lags modulo the cell under the symmetry of the square.

    Attributes:
        of_lag: int64 [m], class of each lag; -1 for short lags of a unit turned at random, of which lag 0 is the first.
        short: [s], lags of the plane that each of these stands for, the first is lag 0; empty if there are none.
        size: [c], residues in each class; sums to dots².
        repeats: [c], short lags of each class; sums to (2 dots - 1)².
    """

    of_lag: NDArray[np.int64]
    short: Floats
    size: Floats
    repeats: Floats

    @cached_property
    def parts(self) -> list[tuple[slice, sparse.csr_array, Mask]]:
        """Lags that are looked at together: which are of each class, [c, lags], and which are short."""
        parts = []
        for start in range(0, len(self.of_lag), _TOGETHER):
            lags = slice(start, start + _TOGETHER)
            of_lag = self.of_lag[lags]
            far = np.flatnonzero(of_lag >= 0)
            shape = len(self.size), len(of_lag)
            parts.append((lags, sparse.csr_array((np.ones(len(far)), (of_lag[far], far)), shape=shape), of_lag < 0))
        return parts


def residues(inner: Interior, *, periodic: bool) -> Residues:
    """The classes for a unit repeated, or turned at random."""
    n = inner.dots
    every, size = residue_classes(n)
    y, x = inner.lags
    of_lag = every[y % n, x % n]
    if not periodic:
        of_lag = np.where(np.maximum(y, x) < n, -1, of_lag)
    lag = np.arange(1 - n, n) % n
    repeats = np.bincount(every[np.ix_(lag, lag)].ravel()).astype(np.float64)
    return Residues(of_lag, inner.count[of_lag < 0], size, repeats)


def residue_classes(n: int) -> tuple[NDArray[np.int64], Floats]:
    """Class of each residue [n, n] under the symmetry of the square, and residues in each [c]."""
    folded = np.minimum(np.arange(n), n - np.arange(n))
    key = np.maximum(folded[:, None], folded) * n + np.minimum(folded[:, None], folded)
    _, every = np.unique(key, return_inverse=True)
    every = every.reshape(n, n)
    return every, np.bincount(every.ravel()).astype(np.float64)


@dataclass(frozen=True, eq=False)
class ResidueDual:
    """The dual function for one ε and level.

    Attributes:
        ratio: ρ.
        nodes: [k], of A/S.
        short: [s, k], cost of each short lag; none of a unit repeated.
        summed: [c, k], cost of all other lags of a class.
    """

    classes: Residues
    ratio: float
    nodes: Floats
    short: Floats
    summed: Floats

    @classmethod
    def of(
        cls, nodes: Floats, cost: Callable[[slice], Floats], classes: Residues, ratio: float, *, periodic: bool
    ) -> ResidueDual:
        """From nodes whose last is 1, and the cost of some lags, [lags, k], as :func:`cost_at` has it."""
        shorts, summed = [], np.zeros((len(classes.size), len(nodes)))
        for lags, members, is_short in classes.parts:
            own = cost(lags)
            summed += members @ own
            if is_short.any():
                shorts.append(own[is_short])
        short = np.concatenate(shorts) if shorts else np.zeros((0, len(nodes)))
        if len(short):
            short[0, :-1] = np.inf
        if periodic:
            summed[0, :-1] = np.inf
        return cls(classes, ratio, nodes, short, summed)

    def __call__(self, mean: float, within: float = 0.0) -> float:
        """Its value at the multipliers μ and κ; no error is less."""
        classes = self.classes
        price = mean * classes.size - within * classes.repeats
        far = (self.summed - price[:, None] * self.nodes).min(axis=1).sum()
        near = (self.short - (within * classes.short)[:, None] * self.nodes).min(axis=1).sum()
        return float(far + near + mean * self.target)

    @property
    def target(self) -> float:
        """Sum of C over all residues."""
        return self.ratio * float(self.classes.size.sum())

    def of_mean(self) -> tuple[float, float]:
        """Largest value of those without κ, and its μ."""
        sizes = self.classes.size[1:, None]
        steepest = float(np.abs(np.diff(self.summed[1:], axis=1) / np.diff(self.nodes) / sizes).max())
        # Light costs: the multiplier is negative where more modulation means less error.
        tries = -np.concatenate([[0.0], steepest * np.geomspace(1e-8, 1, 60)])
        values = [self(v) for v in tries]
        top = int(np.argmax(values))
        low, high = tries[min(top + 1, len(tries) - 1)], tries[max(top - 1, 0)]
        fine = optimize.minimize_scalar(lambda v: -self(v), bounds=(low, high), method="bounded")
        return max(values[top], float(-fine.fun)), float(fine.x)

    def refined(self, price: float = 0.0) -> tuple[float, float, float]:
        """Largest value found, its μ and its κ; κ is sought from there, or from a lower μ."""
        best, mean = self.of_mean()
        if not len(self.short):
            return best, mean, 0.0
        unit = max(-mean, -price, 1e-300)
        start = np.array([[1, 0], [1.3, 0], [0.8, 0.5]])
        optimum = optimize.minimize(
            lambda z: -self(-unit * z[0], -unit * z[1]) / max(best, 1e-300),
            start[0],
            method="Nelder-Mead",
            options={"initial_simplex": start, "maxfev": 200, "xatol": 1e-3, "fatol": 1e-5},
        )
        mean, within = -unit * optimum.x[0], -unit * optimum.x[1]
        return max(best, self(mean, within)), mean, within


def residue_errors(
    inner: Interior, classes: Residues, ratio: float, variances: Sequence[float], *, periodic: bool
) -> list[float]:
    """No unit of this clear share has a smaller error at each σ², whatever the ε.

    Args:
        ratio: ρ.
        variances: σ².
        periodic: the unit is repeated; otherwise turned at random.
    """
    fine, coarse = (nodes_to(1.0, ratio, count) for count in (_NODES, _FEW_NODES))

    def least(variance: float) -> float:
        price = [0.0]

        def bound(nodes: Floats, low: int, high: int) -> float:
            cost = partial(cost_at, nodes, inner, variance, ratio, best_regular(inner, variance, low, high))
            best, mean, _ = ResidueDual.of(nodes, cost, classes, ratio, periodic=periodic).refined(price[0])
            # Where light costs next to nothing without κ, it costs about as much with it as beside other filters.
            price[0] = price[0] or mean
            return best

        # About that ε the best filter of all lies.
        ideal = np.median(variance / (inner.power * inner.inverse_prior))
        first = int(abs(np.log(inner.strengths) - np.log(ideal)).argmin())
        return least_refined(
            len(inner.strengths),
            lambda low, high: bound(coarse, low, high),
            lambda place: bound(fine, place, place + 1),
            first,
        )

    return [least(variance) for variance in variances]
