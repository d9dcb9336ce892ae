"""Design rules of a plate or of any layout, checked exactly."""

from maskfab.geometry.drc.layout import check_layout
from maskfab.geometry.drc.plate import check_plate
from maskfab.geometry.drc.results import RuleResult
from maskfab.geometry.drc.rules import DesignRules
from maskfab.geometry.drc.smallest import Narrowest, narrowest

__all__ = ["DesignRules", "Narrowest", "RuleResult", "check_layout", "check_plate", "narrowest"]
