"""Every rule of an opening, in the order in which they are judged: a microsecond first, the display last."""

from __future__ import annotations

from maskfab.optimiser.rules.dot_rules import KEEP_OUT, RIM, SYMMETRY
from maskfab.optimiser.rules.fit_rule import CENTROID, CIRCUITS, EMITTERS, WIRES
from maskfab.optimiser.rules.port_rule import PORTS
from maskfab.optimiser.rules.rule import Rule
from maskfab.optimiser.rules.spacing_rules import FEATURE, KISSING, SPACE

RULES: tuple[Rule, ...] = (
    KEEP_OUT,
    RIM,
    SYMMETRY,
    KISSING,
    FEATURE,
    SPACE,
    PORTS,
    CIRCUITS,
    EMITTERS,
    WIRES,
    CENTROID,
)
"""Every rule but the count."""
