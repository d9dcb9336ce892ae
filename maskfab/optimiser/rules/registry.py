"""Every rule of an opening, in the order in which they are judged: a microsecond first, emitters last."""

from __future__ import annotations

from maskfab.optimiser.rules.display_rules import CENTROID, CIRCUIT, FOOTPRINT, PORTS, WIRES
from maskfab.optimiser.rules.dot_rules import KEEP_OUT, RIM, SYMMETRY
from maskfab.optimiser.rules.fit_rule import FIT
from maskfab.optimiser.rules.rule import Rule
from maskfab.optimiser.rules.spacing_rules import FEATURE, KISSING, SPACE

RULES: tuple[Rule, ...] = (
    KEEP_OUT,
    RIM,
    SYMMETRY,
    KISSING,
    FEATURE,
    SPACE,
    CIRCUIT,
    WIRES,
    PORTS,
    FOOTPRINT,
    CENTROID,
    FIT,
)
"""Every rule but the count."""
