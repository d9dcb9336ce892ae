"""Proven lower bounds on the interior error of any opening of one clear count, by Lagrangian duality.

**The theorem.** Let every cell of n x n dots hold c clear dots. Pairs of clear dots whose cells lie K apart number c²
times the pairs of such cells, and their lags lie less than n from nK on each axis. With a_K(t) the part of the
pupil's autocorrelation A that they make,

    A(t) = sum over K of a_K(t),    a_K(t) = 0 unless |t - nK| < n,    sum over t of a_K(t) = ρ · (the open stop's),

ρ = c / n². Rearranging dots cannot raise A on average; it moves it inside a block of lags. For a unit repeated, or
turned at random, A(t) = S(t) C(t mod n) at lags of one cell and more: then the mean of C is ρ, so the mean of A/S over
each such block, weighted by the triangle (1 - |d_x|/n)(1 - |d_y|/n) or not, is ρ as well. Around lag 0, and in a layout
drawn by hand, the triangle's mean may be larger (windows between the cells need not hold c dots); the first form holds.

**The dual.** E is a sum over lags of e(A(t)) (:mod:`maskfab.designs.model.expected_psnr`). For all multipliers λ_K >=
0,

    min E  >=  sum over t of min over a of (e(t, a) + λ(t) a)  -  sum over K of λ_K (what block K allows),

λ(t) the least λ_K of the blocks that reach t, whether e is convex or not (weak duality: Boyd, Vandenberghe, Convex
Optimization, 5.1.3). The minimum over a is taken at nodes, less what e can fall below its chord between them, so a
bound stays one in every digit but the last few.

Notes:
    Valid for each ε on its own; the least over the protocol's ε is the bound.
    Inherits the surrogate's model: what sampling folds back is that of a grey panel, and cut cells count as whole ones,
    unless ``cut_cells`` is used.

The dual bound for one unit in every cell, repeated or turned at random: lags that differ by whole cells are alike.

There A(t) = S(t) C(t mod n) at lags of one cell and more, with C the circular autocorrelation of the mean of the unit's
orientations over its clear dots. So all lags of one residue share one number, and the theorem of
:mod:`maskfab.designs.model.duals` becomes one equation, mean of C = ρ, with one multiplier μ. Further
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

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, sparse

from maskfab.base.arrays import Floats
from maskfab.camera.lens import CellGrid
from maskfab.designs.model.expected_psnr import Interior

_NODES = 64


def least_refined(rough: Sequence[float], refined: Callable[[int], float]) -> float:
    """The least of bounds on several errors, with the dear ones found only where they decide.

    Args:
        rough: a bound on each that was cheap.
        refined: a dearer one of the error that stands at a place; where it is lower, the cheap one counts.
    """
    least, done = np.array(rough), set[int]()
    while (place := int(least.argmin())) not in done:
        least[place] = max(least[place], refined(place))
        done.add(place)
    return float(least[place])


@dataclass(frozen=True, eq=False)
class Tables:
    """Contributions of the lags to E at values of A, for one ε; noise is to be multiplied by σ².

    Attributes:
        nodes: [k], values of A/S.
        noise: [m, k], what the filter makes of the noise.
        bias: [m, k], what it holds back.
        noise_dip: [m, k - 1], most by which the noise can fall below its chord between two nodes.
        bias_dip: the same of the bias.
    """

    nodes: Floats
    noise: Floats
    bias: Floats
    noise_dip: Floats
    bias_dip: Floats

    def cost(self, variance: float) -> Floats:
        """[m, k]: lines between these values lie nowhere above what lags add to E at this σ²."""
        value = variance * self.noise + self.bias
        return _lowered(value, variance * self.noise_dip + self.bias_dip)


def dual_tables(inner: Interior, epsilon: float, grey: float, most: float = 1.0) -> Tables:
    """Prepare the dual's minima for lags' A from 0 to ``most`` times the open stop's."""
    # Closer where modulations of displays lie: the chord's error goes with the square of the step.
    nodes = _nodes(grey, most, _NODES)
    slope = inner.stop * inner.pixel
    regular = epsilon * inner.inverse_prior
    h = slope[:, None] * nodes + (grey * inner.folded)[:, None]
    inverse = 1 / (1 + h**2 / regular[:, None])
    squared = inverse**2
    # With u = 1 + H²/R: noise (1/u - 1/u²)/R, bias P/u²; their second slopes by H/√R are at most 6/u² and 20/u³, and
    # these fall with H, so the left end of an interval bounds them.
    by_noise, by_bias = inner.weight / regular, inner.weight * inner.power
    curve = (slope**2 / regular)[:, None] * np.diff(nodes) ** 2 / 8
    return Tables(
        nodes,
        (inverse - squared) * by_noise[:, None],
        squared * by_bias[:, None],
        6 * squared[:, :-1] * by_noise[:, None] * curve,
        20 * (squared * inverse)[:, :-1] * by_bias[:, None] * curve,
    )


def best_regular(inner: Interior, variance: float) -> Floats:
    """R of the best filter at each lag's frequency, [m], among those that ε within the protocol's give.

    An R adds σ² H²/(H² + R)² + P R²/(H² + R)², least at R = σ²/P and greater the further R lies from it, so the best of
    those between the least ε's and the largest's is the nearest.
    """
    wanted = np.divide(variance, inner.power, out=np.full(len(inner.power), np.inf), where=inner.power > 0)
    return np.clip(wanted, inner.strengths[0] * inner.inverse_prior, inner.strengths[-1] * inner.inverse_prior)


def wiener_cost(
    inner: Interior, variance: float, grey: float, most: float = 1.0, count: int = _NODES
) -> tuple[Floats, Floats]:
    """As :class:`Tables`, of the best filter at each frequency, below that of any ε of the protocol.

    Returns:
        Nodes [k] and cost [m, k].
    """
    nodes = _nodes(grey, most, count)
    slope = inner.stop * inner.pixel
    h = slope[:, None] * nodes + (grey * inner.folded)[:, None]
    regular = best_regular(inner, variance)
    inverse = 1 / (1 + h**2 / regular[:, None])
    squared = inverse**2
    by_noise, by_bias = (variance * inner.weight / regular)[:, None], (inner.weight * inner.power)[:, None]
    curve = (slope**2 / regular)[:, None] * np.diff(nodes) ** 2 / 8
    left, u = squared[:, :-1], inverse[:, :-1]
    # As in dual_tables; where R = σ²/P, noise and bias together are P/u, whose second slope is at most 6/u².
    steep = (
        np.where(
            np.isclose(regular * inner.power, variance, rtol=1e-12)[:, None],
            6 * by_bias,
            6 * by_noise + 20 * u * by_bias,
        )
        * left
    )
    return nodes, _lowered((inverse - squared) * by_noise + squared * by_bias, steep * curve)


def _nodes(grey: float, most: float, count: int) -> Floats:
    # A grey panel's modulation is where the best design's lie; the chord's error goes with the square of the step.
    return np.concatenate([[0.0], np.geomspace(min(grey, most) / 8, most, count - 1)])


def _lowered(value: Floats, dip: Floats) -> Floats:
    """Values at nodes less the most by which the function can fall below its chords on either side.

    By H, it rises at most once and then falls: between two nodes it is at least the lower of them.
    """
    rise = np.diff(value, axis=1)
    level = np.abs(rise) < dip
    lowered = value.copy()
    lowered[:, :-1] -= np.where(level, np.maximum(-rise, 0), dip)
    # A node pays for the worse of its two sides only.
    np.minimum(lowered[:, 1:], value[:, 1:] - np.where(level, np.maximum(rise, 0), dip), out=lowered[:, 1:])
    return lowered


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of lags around multiples of the cell, one for each displacement up to the symmetry of the square.

    Attributes:
        covering: int64 [m, 4], the blocks that reach each lag.
        triangle: [m, 4], the triangle's weights in them; sum to 1.
        allowed: [b], at most the sum of a_K over the block, times the number of its images.
    """

    covering: NDArray[np.int64]
    triangle: Floats
    allowed: Floats


def blocks(inner: Interior, ratio: float, *, cut_cells: bool = False, open_share: float | None = None) -> Blocks:
    """The blocks that reach the square of frequencies.

    Args:
        inner: of the camera.
        ratio: ρ, clear share of each cell.
        cut_cells: count what the cells that the stop cuts can hold inside it at most; otherwise they count as if their
            clear dots were spread evenly.
        open_share: clear share of the stop, which cut cells can change; None is ρ.
    """
    n = inner.dots
    cell, part = np.divmod(inner.lags, n)
    share = part / n
    reach = int(cell.max()) + 2
    name = np.full((reach, reach), -1)
    pairs = [(v, u) for u in range(reach) for v in range(u + 1)]
    for number, (v, u) in enumerate(pairs):
        name[v, u] = name[u, v] = number
    corners = [(0, 0), (0, 1), (1, 0), (1, 1)]
    covering = np.stack([name[cell[0] + v, cell[1] + u] for v, u in corners], axis=1)
    triangle = np.stack([abs(1 - v - share[0]) * abs(1 - u - share[1]) for v, u in corners], axis=1)
    # A lag at a multiple of the cell along an axis is not reached by the next block.
    covering = np.where(triangle > 0, covering, covering[:, :1])
    images = np.array([(1 if v == u == 0 else 4 if v in (0, u) else 8) for v, u in pairs], dtype=np.float64)
    light = ratio if open_share is None else open_share
    sums = _cut_cell_sums(inner.lattice, ratio, light, pairs) if cut_cells else ratio * _stop_sums(inner, pairs)
    return Blocks(covering, triangle, images * sums)


def _stop_sums(inner: Interior, pairs: list[tuple[int, int]]) -> Floats:
    """Sums of the open stop's autocorrelation over each block, weighted by the triangle."""
    n, middle = inner.dots, len(inner.stop_table) // 2
    hat = 1 - abs(np.arange(1 - n, n)) / n
    sums = []
    for v, u in pairs:
        block = inner.stop_table[middle + n * v - n + 1 : middle + n * v + n, middle + n * u - n + 1 :][:, : 2 * n - 1]
        sums.append(float(hat[: len(block)] @ block @ hat[: block.shape[1]]))
    return np.array(sums)


def _cut_cell_sums(room: CellGrid, ratio: float, open_share: float, pairs: list[tuple[int, int]]) -> Floats:
    """Most pairs of clear dots for each displacement of cells, over all clear dots.

    Whole cells hold c dots, cut ones up to min(c, their dots inside), as many in all as the light leaves.
    A product of two cut cells is at most the mean of one's count times the other's most, which is linear, so the best
    filling goes from the largest gain down.
    """
    n, cells = room.dots, room.cells
    inside = room.stop.reshape(cells, n, cells, n).sum(axis=(1, 3)).astype(np.float64)
    count = ratio * n * n
    most = np.minimum(inside, count)
    whole = np.where(inside == n * n, count, 0.0)
    cut = np.where(inside == n * n, 0.0, most)
    total = open_share * inside.sum()
    spare = min(total - whole.sum(), float(cut.sum()))
    sums = []
    for v, u in pairs:
        gain = sum(_moved(whole, s * v, s * u) + _moved(cut, s * v, s * u) / 2 for s in (1, -1))
        order = np.argsort(-np.asarray(gain)[cut > 0])
        limits = cut[cut > 0][order]
        taken = np.minimum(limits, np.maximum(spare - np.r_[0, np.cumsum(limits)[:-1]], 0))
        both = float((whole * _moved(whole, v, u)).sum())
        sums.append((both + float(taken @ np.asarray(gain)[cut > 0][order])) / total)
    return np.array(sums)


def _moved(values: Floats, v: int, u: int) -> Floats:
    """values[i + v, j + u], 0 outside."""
    moved = np.zeros_like(values)
    rows, columns = values.shape
    if abs(v) < rows and abs(u) < columns:
        to = slice(max(0, -v), rows - max(0, v)), slice(max(0, -u), columns - max(0, u))
        of = slice(max(0, v), rows - max(0, -v)), slice(max(0, u), columns - max(0, -u))
        moved[to] = values[of]
    return moved


def block_error(
    inner: Interior,
    nodes: Floats,
    cost: Floats,
    around: Blocks,
    ratio: float,
    *,
    moving: bool,
    steps: int,
) -> tuple[float, Floats]:
    """The dual value for one ε, and its multipliers.

    Args:
        inner: of the camera.
        nodes: [k], of A/S.
        cost: [m, k], as :meth:`Tables.cost` gives it for the ε and σ².
        around: what the blocks allow.
        ratio: ρ, where the search for multipliers starts.
        moving: lags take from any block that reaches them, as the theorem for all layouts says; otherwise each block's
            triangle-weighted mean is kept, as in a tiling turned at random.
        steps: evaluations of the dual function; 1 gives the value at the flat modulation's slopes.
    """
    fixed = inner.lags.sum(axis=0) == 0
    unit = inner.count * inner.stop

    def price(multiplier: Floats) -> tuple[Floats, Floats]:
        around_lag = multiplier[around.covering]
        if not moving:
            return (around_lag * around.triangle).sum(axis=1), around.triangle
        cheapest = np.argmin(around_lag, axis=1)
        return around_lag[np.arange(len(around_lag)), cheapest], np.eye(4)[cheapest]

    def dual(multiplier: Floats) -> tuple[float, Floats]:
        by_lag, shares = price(multiplier)
        scaled = cost + (by_lag * unit)[:, None] * nodes
        best = scaled.argmin(axis=1)
        value = np.where(fixed, cost.min(axis=1) + by_lag, scaled[np.arange(len(best)), best])
        used = np.where(fixed, 1.0, unit * nodes[best])
        slope = np.bincount(around.covering.ravel(), (shares * used[:, None]).ravel(), len(multiplier))
        return float(value.sum() - multiplier @ around.allowed), slope - around.allowed

    flat = _flat_prices(nodes, cost, around, ratio, unit)
    value, _ = dual(flat)
    if steps <= 1:
        return value, flat
    # Blocks of long lags have small prices, whose share of the error is not as small.
    scale = np.sqrt(flat * flat.max()) if flat.any() else np.full(len(flat), 1e-12)
    scale = np.maximum(scale, scale[scale > 0].min())
    size = max(abs(value), 1e-300)

    def downhill(z: Floats) -> tuple[float, Floats]:
        value, slope = dual(z * scale)
        return -value / size, -slope * scale / size

    best = optimize.minimize(
        downhill,
        flat / scale,
        jac=True,
        method="L-BFGS-B",
        bounds=[(0, None)] * len(flat),
        options={"maxfun": steps, "maxiter": steps},
    )
    better = np.maximum(best.x, 0) * scale
    improved, _ = dual(better)
    return (improved, better) if improved > value else (value, flat)


def _flat_prices(nodes: Floats, cost: Floats, around: Blocks, ratio: float, unit: Floats) -> Floats:
    """The multipliers at which a flat modulation, of ``unit`` at 1, stays as it is."""
    k = int(np.clip(np.searchsorted(nodes, ratio), 1, len(nodes) - 2))
    steep = (cost[:, k - 1] - cost[:, k + 1]) / (nodes[k + 1] - nodes[k - 1]) / np.maximum(unit, 1e-12)
    flat = np.zeros(len(around.allowed))
    mass = np.bincount(around.covering.ravel(), (around.triangle * unit[:, None]).ravel(), len(flat))
    pull = np.bincount(around.covering.ravel(), (around.triangle * (unit * steep)[:, None]).ravel(), len(flat))
    flat = np.maximum(pull / np.maximum(mass, 1e-12), 0)
    # A block that reaches beyond the square of frequencies has room there, which costs nothing.
    flat[ratio * mass < 0.9 * around.allowed] = 0
    return flat


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
        inner: of the camera.
        classes: of its lags, for the tiling.
        ratio: ρ.
        variances: σ².
        periodic: the unit is repeated; otherwise turned at random.
    """
    duals: list[list[ResidueDual]] = [[] for _ in variances]
    for epsilon in inner.strengths:
        table = dual_tables(inner, epsilon, ratio)
        for of_level, variance in zip(duals, variances, strict=True):
            of_level.append(ResidueDual.of(table.nodes, table.cost(variance), classes, ratio, periodic=periodic))
    return [_least(of_level) for of_level in duals]


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
        cost: [m, k], lowered as in :func:`maskfab.designs.model.duals.wiener_cost`.
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
    finite = np.isfinite(summed)
    row, node = np.nonzero(finite)
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
