"""Outlines of a drawing as points in nanometres: curves as chords with a bound, pieces joined, lines with a width.

A chord over a step h of the parameter leaves its curve by h^2/8 times the largest second derivative at most, that of
linear interpolation (A&S 25.2.1 with 25.2.3). Of a conic that is its larger half axis. Splines are parted into Bezier
curves, exactly, by their polar form (Ramshaw, Blossoming, 1987); second derivatives lie in the hull of differences of
their control points, and of rational ones follow by the rule of quotients.
"""

from __future__ import annotations

import itertools
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

_FEWEST, _MOST_STEPS = 8, 1000
_LARGEST_MITRE = 4.0
"""Length of a mitre over half the width of a line, from where on its corner is cut off (bevelled)."""


def conic(centre: Floats, along: Floats, across: Floats, start: float, stop: float, beside_nm: float = 0.0) -> Floats:
    """Points [n, 2] of ``centre + along cos t + across sin t`` from ``start`` to ``stop``, in radians.

    Args:
        beside_nm: by how much the second derivative of a line beside it is larger.
    """
    largest = float(np.linalg.norm(np.stack([along, across]), 2)) + beside_nm
    steps = abs(stop - start) * math.sqrt(largest / (8 * CHORD_NM))
    t = np.linspace(start, stop, max(_FEWEST, math.ceil(steps)) + 1)[:, None]
    points: Floats = centre + np.cos(t) * along + np.sin(t) * across
    return points


def bulged(
    start: Floats, end: Floats, bulge: float, matrix: Floats, halves_nm: tuple[float, float] = (0.0, 0.0)
) -> Floats:
    """Points [n, 2] from one vertex of a line to the next, on the arc whose quarter angle has the tangent ``bulge``.

    Args:
        start, end: in units of the drawing.
        matrix: nanometres from there [2, 2].
        halves_nm: half the width of the line at both, between which it grows evenly.
    """
    near, far = complex(*start), complex(*end)
    chord, turn, widest = far - near, 4 * math.atan(bulge), max(halves_nm)
    ends = np.stack([start, end]) @ matrix.T
    # As flat as the chords of all else: its centre may lie so far away that nothing of it would be exact.
    if abs(bulge) * (abs(chord) / 2 * np.linalg.norm(matrix, 2) + 2 * widest) <= CHORD_NM:
        return ends
    middle = (near + far) / 2 + 0.5j * chord * (1 - bulge**2) / (2 * bulge)
    radius, angle = abs(near - middle), math.atan2((near - middle).imag, (near - middle).real)
    centre = matrix @ np.array([middle.real, middle.imag])
    # The side p + h n of a line that grows by h' a radian curves by 2 h' besides r + h.
    beside_nm = widest + 2 * abs(halves_nm[1] - halves_nm[0]) / abs(turn)
    points = conic(centre, radius * matrix[:, 0], radius * matrix[:, 1], angle, angle + turn, beside_nm)
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
    """Points of a rational Bezier curve of homogeneous control points [degree + 1, 3]; in halves where one bound on its
    second derivative, which weights of all sizes make large, would be none."""
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
    steps = math.ceil(math.sqrt(second / (8 * CHORD_NM)))
    if steps > _MOST_STEPS:
        rest, first_half, second_half = hull, [], []
        while len(rest):
            first_half.append(rest[0])
            second_half.append(rest[-1])
            rest = (rest[:-1] + rest[1:]) / 2
        return np.concatenate([_bezier(np.array(first_half))[:-1], _bezier(np.array(second_half[::-1]))])
    t = np.linspace(0.0, 1.0, max(1, steps) + 1)
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


def wide_line(rows: Floats, *, closed: bool) -> Iterator[Floats]:
    """Outlines that together are a line with a width: those of its pieces, and corners between them.

    Ends are cut off square. Corners are mitred where both pieces are as wide, and else, or where the mitre would be
    longer than :data:`_LARGEST_MITRE` half widths, cut off between the corners of both pieces.

    Args:
        rows: [n, 5] x, y, width at the start and at the end, in nanometres, and bulge; of a closed line the first comes
            again.
    """
    legs: list[tuple[Floats, Floats, Floats]] = []
    for one, next_one in itertools.pairwise(rows):
        (x, y), halves, bulge = next_one[:2] - one[:2], one[2:4] / 2, one[4]
        if x or y:
            spine = bulged(one[:2], next_one[:2], bulge, np.eye(2), (halves[0], halves[1]))
            turn = 2 * math.atan(bulge) if len(spine) > 2 else 0.0
            across = math.atan2(x, -y) + np.linspace(-turn, turn, len(spine))
            left = np.column_stack([np.cos(across), np.sin(across)])
            legs.append((spine, left, np.linspace(halves[0], halves[1], len(spine))))
    for spine, left, half in legs:
        one_side, other_side = spine + left * half[:, None], spine - left * half[:, None]
        for k in range(len(spine) - 1):
            yield np.stack([one_side[k], one_side[k + 1], other_side[k + 1], other_side[k]])
    for (spine, left, half), (_, next_left, next_half) in itertools.pairwise([*legs, *legs[:closed]]):
        at, one, other = spine[-1], left[-1], next_left[0]
        outside = -math.copysign(1.0, one[0] * other[1] - one[1] * other[0])
        corners = [at, at + outside * one * half[-1], at + outside * other * next_half[0]]
        flat = 1 + float(one @ other)
        if half[0] == half[-1] == next_half[0] == next_half[-1] and flat * _LARGEST_MITRE**2 >= 2:
            corners.insert(2, at + outside * (one + other) / flat * half[0])
        yield np.stack(corners)
