"""Sweeps of which a few cases run in every test run, and all of them in ``make test-all``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest
from hypothesis import settings


def sweep(cases: Iterable[Any], quick: int) -> list[Any]:
    """The cases of a parametrized test, all but the first ``quick`` of them marked as slow."""
    listed = [case if isinstance(case, tuple) else (case,) for case in cases]
    return [pytest.param(*case, marks=[pytest.mark.slow] if n >= quick else []) for n, case in enumerate(listed)]


def examples(full: int) -> settings:
    """As many drawn examples in ``make test-all``; in every run that share of them which its profile draws of 100."""
    return settings(max_examples=full * settings.default.max_examples // 100)
