"""Numerical libraries keep to one thread, however maskfab is started."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import maskfab

ROOT = Path(maskfab.__file__).resolve().parent.parent
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
LOADED = "import numpy, scipy.linalg, scipy.special\nfrom threadpoolctl import threadpool_info\n"
COUNTS = "[pool['num_threads'] for pool in threadpool_info() if pool['user_api'] == 'blas']"


def counts(code: str, **variables: str) -> list[list[int]]:
    """What a program prints that starts with no word about threads but these, on a machine with several cores."""
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES} | variables
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, env=environment
    )
    return [json.loads(line) for line in done.stdout.splitlines() if line.startswith("[")]


@pytest.fixture(scope="module")
def plain() -> list[int]:
    """Threads of every linear algebra where nobody limits them."""
    (found,) = counts(f"{LOADED}print({COUNTS})")
    if max(found) == 1:
        pytest.skip("one core")
    return found


def test_every_verb_starts_libraries_with_one_thread(plain: list[int]) -> None:
    code = (
        "import sys\nsys.argv = ['maskfab', 'explain', 'MF106']\nfrom maskfab.__main__ import main\n"
        f"try:\n    main()\nexcept SystemExit:\n    pass\n{LOADED}print({COUNTS})"
    )
    assert counts(code) == [[1] * len(plain)]
    assert max(counts(code, OPENBLAS_NUM_THREADS="2")[0]) == 2


def test_a_program_that_calls_us_keeps_its_own_threads_and_lends_us_one(plain: list[int]) -> None:
    code = (
        f"{LOADED}import maskfab\n"
        "camera = maskfab.Camera('10 mm', stop='400 um', wavelengths='530 nm', pixel='4 um', window='64 um')\n"
        f"told = lambda *_: print({COUNTS})\ntold()\n"
        "maskfab.analyse('layouts/openings/toled.toml', camera, progress=told)\ntold()"
    )
    before, *within, after = counts(code)
    assert max(before) > 1
    assert after == before
    assert within
    assert all(max(found) == 1 for found in within)


def test_a_library_that_is_loaded_between_two_calls_is_limited_too(plain: list[int]) -> None:
    code = (
        "import json, numpy\nfrom maskfab.base.work import one_thread\nfrom threadpoolctl import threadpool_info\n"
        f"told = one_thread(lambda: print({COUNTS}))\ntold()\nimport scipy.linalg\ntold()"
    )
    alone, both = counts(code)
    assert len(both) > len(alone)
    assert max(both) == 1
