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


def in_turns(few: Iterable[Any], many: Iterable[Any]) -> list[tuple[Any, Any]]:
    """All pairs, those first that hold each of the many once and the few in turns."""
    short, long = list(few), list(many)
    return [(short[(n + k) % len(short)], each) for k in range(len(short)) for n, each in enumerate(long)]


def examples(full: int) -> settings:
    """As many drawn examples in ``make test-all``; in every run that share of them which its profile draws of 100."""
    return settings(max_examples=max(1, full * settings.default.max_examples // 100))
