"""Figures of four equal arms."""

from __future__ import annotations

from collections.abc import Sequence

from maskfab.model import Point, Polygon


def four_arms(centre_nm: Point, arm: Sequence[Point]) -> Polygon:
    """One outline from one arm and its three quarter turns.

    Args:
        centre_nm: what the arm is turned round.
        arm: counter-clockwise outline of the upper arm about (0, 0), from its right foot to its left one, where the
            next arm starts.
    """
    turned = [list(arm)]
    for _ in range(3):
        turned.append([(-y, x) for x, y in turned[-1]])
    points = dict.fromkeys(point for side in turned for point in side)
    return tuple((centre_nm[0] + x, centre_nm[1] + y) for x, y in points)
