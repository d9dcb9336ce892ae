"""Outlines of a drawing as points in nanometres: curves as chords with a bound, pieces joined, lines with a width.

A chord over a step h of the parameter leaves its curve by h^2/8 times the largest second derivative at most, that of
linear interpolation (A&S 25.2.1 with 25.2.3). Of a conic that is its larger half axis. Splines are parted into Bezier
curves, exactly, by their polar form (Ramshaw, Blossoming, 1987); second derivatives lie in the hull of differences of
their control points, and of rational ones follow by the rule of quotients.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from math import comb

import numpy as np

from maskfab.base.arrays import Floats

CHORD_NM = 1.0
"""Largest distance of a chord from its curve."""

LONE_TIMES = 10
"""Times that ends which lie alone may be further apart than others: no other line could be meant."""

_FEWEST = 8
_LARGEST_MITRE = 4.0
"""Length of a mitre over half the width of a line, from where on its corner is cut off (bevelled)."""


def conic(centre: Floats, along: Floats, across: Floats, start: float, stop: float, beside_nm: float = 0.0) -> Floats:
    """Points [n, 2] of ``centre + along cos t + across sin t`` from ``start`` to ``stop``, in radians.

    Args:
        beside_nm: how far outside of it a line is to stay as close to its curve.
    """
    largest = float(np.linalg.norm(np.stack([along, across]), 2)) + beside_nm
    steps = abs(stop - start) * math.sqrt(largest / (8 * CHORD_NM))
    t = np.linspace(start, stop, max(_FEWEST, math.ceil(steps)) + 1)[:, None]
    points: Floats = centre + np.cos(t) * along + np.sin(t) * across
    return points


def bulged(start: Floats, end: Floats, bulge: float, matrix: Floats, beside_nm: float = 0.0) -> Floats:
    """Points [n, 2] from one vertex of a line to the next, on the arc whose quarter angle has the tangent ``bulge``.

    Args:
        start, end: in units of the drawing.
        matrix: nanometres from there [2, 2].
        beside_nm: as of :func:`conic`.
    """
    near, far = complex(*start), complex(*end)
    chord = far - near
    ends = np.stack([start, end]) @ matrix.T
    # As flat as the chords of all else: its centre may lie so far away that nothing of it would be exact.
    if abs(bulge) * abs(chord) / 2 * np.linalg.norm(matrix, 2) <= CHORD_NM:
        return ends
    middle = (near + far) / 2 + 0.5j * chord * (1 - bulge**2) / (2 * bulge)
    radius, angle = abs(near - middle), math.atan2((near - middle).imag, (near - middle).real)
    centre = matrix @ np.array([middle.real, middle.imag])
    points = conic(centre, radius * matrix[:, 0], radius * matrix[:, 1], angle, angle + 4 * math.atan(bulge), beside_nm)
    points[0], points[-1] = ends
    return points


def spline(control: Floats, weights: Floats, knots: Floats, degree: int) -> Floats:
    """Points [n, 2] of a B-spline over its whole domain.

    Args:
        control: [n, 2] in nanometres.
        weights: [n], above 0.
        knots: [n + degree + 1], none below the one before.
    """
    hull = np.column_stack([control * weights[:, None], weights])
    points = [hull[:0, :2]]
    for k in range(degree, len(control)):
        if knots[k + 1] > knots[k]:
            low, high = knots[k], knots[k + 1]
            bezier = np.array([_blossom(hull, knots, k, [low] * (degree - j) + [high] * j) for j in range(degree + 1)])
            part = _bezier(bezier)
            points.append(part if len(points) == 1 else part[1:])
    return np.concatenate(points)


def _blossom(hull: Floats, knots: Floats, k: int, at: Sequence[float]) -> Floats:
    degree = len(at)
    rows = hull[k - degree : k + 1].copy()
    for level, t in enumerate(at, 1):
        for j in range(degree, level - 1, -1):
            i = k - degree + j
            share = (t - knots[i]) / (knots[i + degree - level + 1] - knots[i])
            rows[j] = (1 - share) * rows[j - 1] + share * rows[j]
    row: Floats = rows[degree]
    return row


def _bezier(hull: Floats) -> Floats:
    """Points of a rational Bezier curve of homogeneous control points [degree + 1, 3]."""
    degree, weight = len(hull) - 1, hull[:, 2:]
    origin = (hull[:, :2] / weight).mean(axis=0)
    moved = hull[:, :2] - weight * origin
    reach, least = float(np.linalg.norm(moved / weight, axis=1).max()), float(weight.min())

    def derivative(of: Floats, order: int) -> float:
        if order > degree:
            return 0.0
        return math.perm(degree, order) * float(np.linalg.norm(np.diff(of, order, axis=0), axis=1).max())

    first = (derivative(moved, 1) + derivative(weight, 1) * reach) / least
    second = (derivative(moved, 2) + 2 * derivative(weight, 1) * first + derivative(weight, 2) * reach) / least
    t = np.linspace(0.0, 1.0, max(1, math.ceil(math.sqrt(second / (8 * CHORD_NM)))) + 1)
    terms = np.stack([comb(degree, j) * t**j * (1 - t) ** (degree - j) for j in range(degree + 1)], axis=1)
    points: Floats = origin + (terms @ moved) / (terms @ weight)
    return points


class Chains:
    """Open pieces whose ends meet, joined to outlines: ends within a distance, and two that else lie alone within
    :data:`LONE_TIMES` as far, if no third does.

    Attributes:
        groups: outlines [n, 2], those together that share an end, with the numbers of their pieces, and, where more
            than two ends meet, the place and how many do.
        faults: where a piece ends alone, or an odd number meets: the place, and how many ends lie there.
        gap_nm: the largest distance of ends that were joined.
        ends: of all pieces [2 n, 2], the first of each before its last.
    """

    def __init__(self, pieces: Sequence[Floats], within_nm: float) -> None:
        self.groups: list[tuple[list[Floats], list[int], tuple[Floats, int] | None]] = []
        self.faults: list[tuple[Floats, int]] = []
        self.gap_nm = 0.0
        self._pieces = pieces
        self.ends = ends = np.array([end for piece in pieces for end in (piece[0], piece[-1])]).reshape(-1, 2)
        nodes = _near(ends, within_nm)
        count = Counter(nodes)
        lone = [end for end, node in enumerate(nodes) if count[node] == 1]
        near: dict[int, list[int]] = defaultdict(list)
        for end, place in zip(lone, _near(ends[lone], LONE_TIMES * within_nm), strict=True):
            near[place].append(end)
        for pair in near.values():
            if len(pair) == 2:
                nodes[pair[1]] = nodes[pair[0]]
        self._at: dict[int, list[int]] = defaultdict(list)
        for end, node in enumerate(nodes):
            self._at[node].append(end)
        self._nodes = nodes
        seen = [False] * len(pieces)
        for first in range(len(pieces)):
            if not seen[first]:
                self._follow(first, seen, ends)

    def _follow(self, first: int, seen: list[bool], ends: Floats) -> None:
        reached, todo = [], [first]
        seen[first] = True
        while todo:
            piece = todo.pop()
            reached.append(piece)
            for node in self._nodes[2 * piece : 2 * piece + 2]:
                for other in {end // 2 for end in self._at[node]}:
                    if not seen[other]:
                        seen[other] = True
                        todo.append(other)
        nodes = dict.fromkeys(node for piece in reached for node in self._nodes[2 * piece : 2 * piece + 2])
        met = [(ends[self._at[node][0]], len(self._at[node])) for node in nodes if len(self._at[node]) != 2]
        if odd := [fault for fault in met if fault[1] % 2]:
            self.faults += odd
            return
        following: dict[int, int] = {}
        for node in nodes:
            # Neighbours by their direction, so that outlines that touch do not cross there.
            at = sorted(self._at[node], key=self._direction)
            for one, other in zip(at[::2], at[1::2], strict=True):
                following[one], following[other] = other, one
                self.gap_nm = max(self.gap_nm, float(np.linalg.norm(ends[one] - ends[other])))
        loops, left = [], dict.fromkeys(reached)
        while left:
            points, end = [], 2 * next(iter(left))
            while end // 2 in left:
                del left[end // 2]
                line = self._pieces[end // 2]
                points.append(line[:-1] if end % 2 == 0 else line[:0:-1])
                end = following[end ^ 1]
            loops.append(np.concatenate(points))
        self.groups.append((loops, reached, met[0] if met else None))

    def _direction(self, end: int) -> float:
        piece = self._pieces[end // 2]
        x, y = piece[1] - piece[0] if end % 2 == 0 else piece[-2] - piece[-1]
        return math.atan2(y, x)


def _near(points: Floats, within: float) -> list[int]:
    """A number for each point, alike for points that lie within a distance of each other, or of others that do."""
    owner = list(range(len(points)))

    def root(number: int) -> int:
        while owner[number] != number:
            owner[number] = owner[owner[number]]
            number = owner[number]
        return number

    squares: dict[tuple[int, int], list[int]] = defaultdict(list)
    for number, (x, y) in enumerate(points.tolist()):
        column, row = math.floor(x / within), math.floor(y / within)
        for square in ((column + i, row + j) for i in (-1, 0, 1) for j in (-1, 0, 1)):
            for other in squares.get(square, ()):
                if math.hypot(x - points[other, 0], y - points[other, 1]) <= within:
                    owner[root(number)] = root(other)
        squares[column, row].append(number)
    return [root(number) for number in range(len(points))]


def wide_line(points: Floats, widths: Floats, *, closed: bool) -> Iterator[Floats]:
    """Outlines that together are a line with a width: one for each straight piece, and the corners between them.

    Ends are cut off square. Corners are mitred where both pieces are as wide there, and else, or where the mitre would
    be longer than :data:`_LARGEST_MITRE` half widths, cut off between the corners of both pieces.

    Args:
        points: [n, 2] in nanometres, none twice in a row; of a closed line the first comes again.
        widths: [n - 1, 2] of each piece at its beginning and its end.
    """
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    left = np.column_stack([-along[:, 1], along[:, 0]])
    sides = np.array(
        [[points[:-1] + s * left * widths[:, :1] / 2, points[1:] + s * left * widths[:, 1:] / 2] for s in (1, -1)]
    )
    count = len(along)
    for i in range(count if closed else count - 1):
        j = (i + 1) % count
        turn = left[i] + left[j]
        flat = float(turn @ turn) / 2  # 1 + the cosine of the turn
        if widths[i, 1] == widths[j, 0] == widths[i, 0] == widths[j, 1] and flat * _LARGEST_MITRE**2 >= 2:
            # Both sides meet there, and the straight pieces end at the mitre.
            for side, s in enumerate((1, -1)):
                sides[side, 1, i] = sides[side, 0, j] = points[i + 1] + s * turn / flat * widths[i, 1] / 2
        else:
            for side in (0, 1):
                yield np.stack([points[i + 1], sides[side, 1, i], sides[side, 0, j]])
    for i in range(count):
        yield np.stack([sides[0, 0, i], sides[0, 1, i], sides[1, 1, i], sides[1, 0, i]])
