"""Symmetric ports: where lines cross a cell so that they meet those of any neighbour, however it is turned."""

from __future__ import annotations

from typing import TYPE_CHECKING

from maskfab.base.arrays import Mask
from maskfab.display.wires.ports import ports
from maskfab.optimiser.rules.rule import Conflict, Rule

if TYPE_CHECKING:
    from maskfab.optimiser.rules.constraints import Constraints


def _few_ports(constraints: Constraints, unit: Mask) -> str | None:
    wanted = constraints["ports"]
    found = ports(~unit, enough=wanted)
    more = "" if found.exact else " were found"
    return f"{found.count} symmetric ports{more}, least {wanted}" if found.count < wanted else None


def _by_lines(constraints: Constraints) -> Conflict | None:
    """A line through every port closes a dot of each row, and the count leaves fewer."""
    wanted, dots = constraints["ports"], constraints.dots
    most = dots * (dots - min(wanted, dots))
    if wanted <= dots and constraints.clear_dots <= most:
        return None
    return Conflict(
        ("ports", "clear_dots") if wanted <= dots else ("ports",),
        f"{wanted} lines close {wanted} dots of every row, so that at most {most} of {dots} x {dots} are clear",
    )


PORTS = Rule("ports", "ports", _few_ports, proof=_by_lines, one_place=lambda _: True, slow=True)
