"""Searches once more without each rule: what an annealing gains that need not keep it.

A scan judges shapes whether or not they keep the rules, so that it prices them by the way. An annealing keeps every
rule from its first step to its last, and has to be repeated for that.
"""

from __future__ import annotations

import time

from maskfab.jobfile import SearchSection
from maskfab.optimiser.account import Without
from maskfab.optimiser.rules.constraints import Constraints
from maskfab.optimiser.rules.discrete import Objective, anneal
from maskfab.optimiser.search.scan import Best
from maskfab.progress import Progress


def annealed_without(
    found: Best, section: SearchSection, rules: Constraints, objective: Objective, progress: Progress
) -> Without:
    """Annealings by the photographs that are restored, one without each rule.

    Each annealing is as long as the search's own, has its seed, and begins at the best opening that keeps the others.

    Args:
        found: the search after its annealing.
        section: of a job, with its evaluations and its seed.
        rules: that the search kept.
        objective: of the search.
        progress: told at every multiple of 64 evaluations.
    """
    gains, begun_s = {}, time.process_time()
    for left_out in rules.active:
        others = rules.without(left_out)
        begun = [(objective(found.best.unit), found.best.unit)]
        # The best shapes come first, whether or not they keep any rule.
        first = next((each.unit for each in found.looked if others.allows(each.unit)), None)
        if first is not None:
            begun.append((objective(first), first))
        _, start = max(begun, key=lambda each: each[0])
        walked = anneal(
            start,
            objective,
            others,
            evaluations=section.anneal,
            seed=section.seed,
            progress=lambda stage, done, total, rule=left_out: progress(f"without {rule}: {stage}", done, total),  # type: ignore[misc]
        )
        gains[left_out] = max(walked.value - found.best.value, 0.0)
    return Without(gains, time.process_time() - begun_s)
