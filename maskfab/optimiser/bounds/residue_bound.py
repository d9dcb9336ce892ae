r"""The dual bound for one unit in every cell, repeated or turned at random: lags that differ by whole cells are alike.

There A(t) = S(t) C(t mod n) at lags of one cell and more, with C the circular autocorrelation of the mean of the unit's
orientations over its clear dots. So all lags of one residue share one number, and the theorem of
:mod:`maskfab.optimiser.bounds.error_bound` becomes one equation, mean of C = ρ, with one multiplier μ. Further
constraints:

* 0 <= C <= 1;
* repeated: C(0) = 1, and the same C at short lags;
* turned at random: A = S Q at short lags, Q(0) = 1, 0 <= Q <= 1. Pairs within a cell number c² however it is turned, so
  the sum of Q over the (2n - 1)² short lags is that of C(t mod n), with a multiplier κ;
* positive semidefinite: every coefficient of the cosine transform of C is at least 0, as it is a squared modulus.

By symmetry under the square's eight elements the best multipliers are symmetric, so a bound by classes of residues is
one for every C. Where the lags lack that symmetry, classes hold a residue and its negative alone, as C(-t) = C(t).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse

from maskfab.base.arrays import Floats
from maskfab.optimiser.bounds.error_bound import dual_tables, least_refined
from maskfab.optimiser.model.interior import Interior


@dataclass(frozen=True, eq=False)
class Residues:
    """Classes of lags modulo the cell under the symmetry of the square.

    Attributes:
        of_lag: int64 [m], class of each lag; -1 for short lags of a unit turned at random, of which lag 0 is the first.
        short: [s], lags of the plane that each of these stands for, the first is lag 0; empty if there are none.
        size: [c], residues in each class; sums to dots².
        repeats: [c], short lags of each class; sums to (2 dots - 1)².
        transform: [c, c], coefficient of each class of frequencies by the value of C on each class of residues.
    """

    of_lag: NDArray[np.int64]
    short: Floats
    size: Floats
    repeats: Floats
    transform: Floats


def residues(inner: Interior, *, periodic: bool, mirrored: bool = True) -> Residues:
    """The classes for a unit repeated, or turned at random.

    Args:
        inner: whose lags are put into classes.
        periodic: the unit is repeated.
        mirrored: the lags have the symmetry of the square; a unit turned at random needs it.
    """
    n = inner.dots
    every, size, transform = residue_classes(n, mirrored=mirrored)
    y, x = inner.lags
    of_lag = every[y % n, x % n]
    if not periodic:
        of_lag = np.where(np.maximum(y, x) < n, -1, of_lag)
    lag = np.arange(1 - n, n) % n
    repeats = np.bincount(every[np.ix_(lag, lag)].ravel()).astype(np.float64)
    return Residues(of_lag, inner.count[of_lag < 0], size, repeats, transform)


def residue_classes(n: int, *, mirrored: bool = True) -> tuple[NDArray[np.int64], Floats, Floats]:
    """Class of each residue [n, n], residues in each [c], and the cosine transform between classes [c, c].

    Args:
        n: dots along the unit's side.
        mirrored: classes under the symmetry of the square; otherwise a residue and its negative.
    """
    if mirrored:
        folded = np.minimum(np.arange(n), n - np.arange(n))
        key = np.maximum(folded[:, None], folded) * n + np.minimum(folded[:, None], folded)
    else:
        back = -np.arange(n) % n
        key = np.minimum(np.arange(n)[:, None] * n + np.arange(n), back[:, None] * n + back)
    _, every = np.unique(key, return_inverse=True)
    every = every.reshape(n, n)
    size = np.bincount(every.ravel()).astype(np.float64)
    heads = np.unique(every, return_index=True)[1]
    phase = 2 * np.pi * np.outer(np.arange(n), np.arange(n)) / n
    cosine = np.cos(phase)
    transform = np.empty((len(size), len(size)))
    for row, head in enumerate(heads):
        v, u = divmod(int(head), n)
        # The mean over mirror images of a wave is a product of cosines.
        wave = np.outer(cosine[v], cosine[u]) if mirrored else np.cos(phase[v][:, None] + phase[u])
        transform[row] = np.bincount(every.ravel(), wave.ravel())
    return every, size, transform


@dataclass(frozen=True, eq=False)
class ResidueDual:
    """The dual function for one ε and level.

    Attributes:
        classes: for the tiling.
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
    def of(cls, nodes: Floats, cost: Floats, classes: Residues, ratio: float, *, periodic: bool) -> ResidueDual:
        """From the cost [m, k] of every lag; arguments as of :func:`residue_error`."""
        free = classes.of_lag < 0
        short = cost[free]
        if len(short):
            short[0, :-1] = np.inf
        count = len(classes.size)
        members = sparse.csr_array(
            (np.ones(int((~free).sum())), (classes.of_lag[~free], np.flatnonzero(~free))), shape=(count, len(free))
        )
        summed = np.asarray(members @ cost)
        if periodic:
            summed[0, :-1] = np.inf
        return cls(classes, ratio, nodes, short, summed)

    def __call__(self, mean: float, within: float = 0.0, positivity: Floats | None = None) -> float:
        """Its value at the multipliers μ, κ and [c] those of C's transform; no error is less."""
        classes = self.classes
        price = mean * classes.size - within * classes.repeats
        if positivity is not None:
            price = price + positivity @ classes.transform
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

    def refined(self, best: float, mean: float) -> tuple[float, float, float]:
        """Largest value found from there, its μ and its κ."""
        if not len(self.short):
            return best, mean, 0.0
        unit = max(-mean, 1e-300)
        start = np.array([[1, 0], [1.3, 0], [0.8, 0.5]])
        found = optimize.minimize(
            lambda z: -self(-unit * z[0], -unit * z[1]) / max(best, 1e-300),
            start[0],
            method="Nelder-Mead",
            options={"initial_simplex": start, "maxfev": 200, "xatol": 1e-3, "fatol": 1e-5},
        )
        mean, within = -unit * found.x[0], -unit * found.x[1]
        return max(best, self(mean, within)), mean, within


def residue_errors(
    inner: Interior, classes: Residues, ratio: float, variances: Sequence[float], *, periodic: bool
) -> list[float]:
    """No unit of this clear share has a smaller error at each σ², whatever the ε.

    Args:
        inner: of the camera.
        classes: of its lags, for the tiling.
        ratio: ρ.
        variances: σ².
        periodic: the unit is repeated; otherwise turned at random.
    """
    duals: list[list[ResidueDual]] = [[] for _ in variances]
    for epsilon in inner.strengths:
        table = dual_tables(inner, epsilon, ratio)
        for found, variance in zip(duals, variances, strict=True):
            found.append(ResidueDual.of(table.nodes, table.cost(variance), classes, ratio, periodic=periodic))
    return [_least(each) for each in duals]


def _least(duals: list[ResidueDual]) -> float:
    rough = [dual.of_mean() for dual in duals]
    return least_refined([value for value, _ in rough], lambda place: duals[place].refined(*rough[place])[0])


def residue_error(
    nodes: Floats,
    cost: Floats,
    classes: Residues,
    ratio: float,
    *,
    periodic: bool,
    refined: bool = False,
    positive: bool = False,
) -> float:
    """The dual value: no C of mean ``ratio`` has a smaller E.

    Args:
        nodes: [k], of A/S, the last is 1.
        cost: [m, k], lowered as in :func:`maskfab.optimiser.bounds.error_bound.wiener_cost`.
        classes: for the tiling.
        ratio: ρ.
        periodic: C(0) = 1.
        refined: use that pairs within a cell number c² (turned at random only).
        positive: use that C is positive semidefinite, by a linear programme whose multipliers are then checked.
    """
    dual = ResidueDual.of(nodes, cost, classes, ratio, periodic=periodic)
    best, mean = dual.of_mean()
    within = 0.0
    if refined:
        best, mean, within = dual.refined(best, mean)
    if not positive:
        return best
    count, target = len(classes.size), dual.target
    summed = dual.summed + (within * classes.repeats)[:, None] * nodes
    kept = np.isfinite(summed)
    row, node = np.nonzero(kept)
    scale = float(summed[:, np.searchsorted(nodes, ratio)][1:].sum())
    value = nodes[node]
    equal = sparse.vstack(
        [
            sparse.csr_array((np.ones(len(row)), (row, np.arange(len(row)))), shape=(count, len(row))),
            sparse.csr_array((classes.size[row] * value)[None]),
        ]
    )
    solved = optimize.linprog(
        summed[row, node] / scale,
        A_ub=-classes.transform[:, row] * value,
        b_ub=np.zeros(count),
        A_eq=equal,
        b_eq=np.r_[np.ones(count), target],
        bounds=(0, None),
        method="highs",
    )
    if not solved.success:
        return best
    positivity = np.maximum(-np.asarray(solved.ineqlin.marginals), 0) * scale
    return max(best, dual(float(solved.eqlin.marginals[-1]) * scale, within, positivity))
