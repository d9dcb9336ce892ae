"""Rules on the names of cells."""

from __future__ import annotations

import re
from collections.abc import Iterable

from maskfab.drc.results import RuleResult
from maskfab.drc.rules import DesignRules


def checked_names(names: Iterable[str], rules: DesignRules) -> tuple[RuleResult, ...]:
    """One result for each rule on names; names that break it are listed in alphabetical order."""
    every = sorted(names)
    results = []
    if rules.name_pattern is not None:
        pattern = re.compile(rules.name_pattern)
        bad = tuple(name for name in every if pattern.fullmatch(name) is None)
        results.append(_result("name_pattern", rules.name_pattern, "", bad))
    for text in rules.forbidden_names:
        bad = tuple(name for name in every if text.casefold() in name.casefold())
        results.append(_result("forbidden_name", text, "", bad))
    if rules.max_name_length is not None:
        bad = tuple(name for name in every if len(name) > rules.max_name_length)
        longest = max((len(name) for name in bad), default=None)
        results.append(RuleResult("name_length", rules.max_name_length, "characters", longest, len(bad), names=bad))
    return tuple(results)


def _result(rule: str, limit: str, unit: str, bad: tuple[str, ...]) -> RuleResult:
    return RuleResult(rule, limit, unit, bad[0] if bad else None, len(bad), names=bad)
