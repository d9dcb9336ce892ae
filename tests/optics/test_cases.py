"""Every hard case that ``maskfab self bench --hard`` prints, held to its limit."""

from __future__ import annotations

import numpy as np
import pytest

from maskfab.trials.hard_cases import CASES, Case, run_cases


@pytest.mark.parametrize(
    "case", [pytest.param(case, id=case.name, marks=[pytest.mark.slow] if case.slow else []) for case in CASES]
)
def test_hard_case(case: Case) -> None:
    (outcome,) = run_cases([case])
    assert outcome.passed, f"{case.name}: error {outcome.error:.2e} above {case.limit:.0e} ({case.method})"


def test_names_are_unique() -> None:
    assert len({case.name for case in CASES}) == len(CASES)


@pytest.mark.parametrize(
    ("error", "passed"), [(1e-9, True), (1e-8, True), (1.1e-8, False), (np.nan, False), (np.inf, False)]
)
def test_only_an_error_within_the_limit_passes(error: float, passed: bool) -> None:
    (outcome,) = run_cases([Case("case", "method", lambda: error, 1e-8)])
    assert outcome.passed is passed
    assert outcome.seconds >= 0


def test_limits_are_small_numbers() -> None:
    assert all(0 < case.limit <= 5e-6 for case in CASES)
