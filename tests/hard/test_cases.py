"""Every hard case that ``maskfab bench --hard`` prints, held to its limit."""

from __future__ import annotations

import pytest

from maskfab.validate.cases import CASES, Case, run


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_hard_case(case: Case) -> None:
    (outcome,) = run([case])
    assert outcome.passed, f"{case.name}: error {outcome.error:.2e} above {case.limit:.0e} ({case.method})"


def test_names_are_unique() -> None:
    assert len({case.name for case in CASES}) == len(CASES)
