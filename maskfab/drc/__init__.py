"""Design rules of a plate or of any layout, checked exactly."""

from maskfab.drc.layout_rules import check_layout
from maskfab.drc.panel_rules import Narrowest, narrowest
from maskfab.drc.plate_rules import check_plate
from maskfab.drc.results import RuleResult
from maskfab.drc.rules import DesignRules

__all__ = ["DesignRules", "Narrowest", "RuleResult", "check_layout", "check_plate", "narrowest"]
