"""Result of drawing a mark: figures, and the gauges by which they are measured."""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.model import Furniture, Gauge


@dataclass(frozen=True)
class Drawn:
    """Furniture with its gauges; most marks have none."""

    furniture: tuple[Furniture, ...]
    gauges: tuple[Gauge, ...] = ()


def multiple_name(multiple: float) -> str:
    """A multiple of the smallest feature as part of a cell's name: ``1_5X``."""
    return f"{multiple:g}".replace(".", "_") + "X"
