"""Equal fingerprints only for values from which the same is found."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from datetime import date
from enum import Enum
from functools import partial
from importlib import metadata
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from klayout import db
from small_job import write_job

from maskfab.base import provenance
from maskfab.mask.job import load_job
from maskfab.runs.store import fingerprint, of_installation

SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text() | st.binary()
VALUES = st.recursive(SCALARS, lambda inner: st.lists(inner).map(tuple) | st.lists(inner), max_leaves=8)


class Side(Enum):
    LEFT = 1


@dataclass(frozen=True)
class Size:
    width: float


@dataclass(frozen=True)
class Weight:
    width: float


DISTINCT: tuple[Any, ...] = (
    None, 0, 0.0, -0.0, False, "", b"", "0", (), [], (0,), [0], ((0,),), (0, 0), ((0, 0),), ((0,), (0,)), frozenset(),
    {}, {"a": 1, "b": 2}, {"b": 2, "a": 1}, Side.LEFT, Size(1.0), Weight(1.0), Size(2.0), "a", fingerprint,
    date(2026, 1, 2), date(2026, 1, 3), pytest.fixture, partial(fingerprint, 1),
    partial(fingerprint, 2), np.zeros(4), np.zeros((2, 2)), np.zeros(4, int),
    np.float32(0), np.asfortranarray(np.arange(4.0).reshape(2, 2)), np.arange(4.0).reshape(2, 2), db.Region(),
    db.Region(db.Box(0, 0, 1, 1)), db.Region(db.Box(0, 0, 2, 1)), Size, Side, ("a", "b"), ("a, b",), (True,), (1,),
)  # fmt: skip


def test_values_that_differ_in_kind_order_or_content_have_other_fingerprints():
    assert len({fingerprint(value) for value in DISTINCT}) == len(DISTINCT)


@given(VALUES, VALUES)
def test_fingerprints_are_equal_where_values_read_alike(one, other):
    assert (fingerprint(one) == fingerprint(other)) == (repr(one) == repr(other))


@given(st.lists(VALUES), st.lists(VALUES))
def test_what_is_said_first_does_not_run_into_the_next(one, other):
    assert (fingerprint(*one) == fingerprint(*other)) == (repr(one) == repr(other))


def test_a_read_only_view_is_as_good_as_its_mapping():
    assert fingerprint(MappingProxyType({"a": 1})) == fingerprint({"a": 1})


@pytest.mark.parametrize("value", [object(), lambda: None, np.array([object()]), iter(()), (1, object())])
def test_what_may_hold_more_than_it_shows_has_none(value):
    with pytest.raises(TypeError, match="no"):
        fingerprint(value)


@pytest.mark.parametrize("name", ["numpy", "openimageio", "cadquery", "jinja2"])
def test_another_version_of_any_library_is_another_installation(monkeypatch, name):
    """Also of those that write files alone: what they wrote before is not what they write now."""
    version, here = metadata.version, of_installation()
    monkeypatch.setattr(provenance, "_libraries", provenance._libraries.__wrapped__)
    monkeypatch.setattr(metadata, "version", lambda each: "0.0" if each.lower() == name else version(each))
    assert of_installation.__wrapped__() != here


def test_another_process_finds_the_same(tmp_path):
    job = write_job(tmp_path)
    text = (
        "from maskfab.runs.store import *; from maskfab.mask.job import load_job; import sys;"
        "print(fingerprint(of_installation(), load_job(sys.argv[1]).spec, frozenset('abc')))"
    )
    there = subprocess.run([sys.executable, "-c", text, job], capture_output=True, text=True, check=True)
    assert there.stdout.strip() == fingerprint(of_installation(), load_job(job).spec, frozenset("abc"))
