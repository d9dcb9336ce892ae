"""A T-OLED slit with three stripes: openings by hand, emitters by hand."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from maskfab.base.model import Emitters, Opening, Panel, Tiling
from maskfab.display.emitted_light import Viewing

INCH_UM = 25400.0


def slit(order=(1, 3, 2), *, count=100, dot_nm=4032, tiling=Tiling.RANDOM, gutter_nm=0, seed=1) -> Panel:
    """A slit five of 21 dots wide, a stripe left of it and two right of it, in an order of colours."""
    mask = np.zeros((21, 21), dtype=np.bool_)
    mask[:, 5:10] = True
    labels = np.zeros((42, 42), dtype=np.int8)
    labels[:, 0:9], labels[:, 20:30], labels[:, 32:42] = order
    return panel_of(mask, labels, dot_nm, count=count, tiling=tiling, gutter_nm=gutter_nm, seed=seed)


def panel_of(mask, labels, dot_nm, *, count=100, tiling=Tiling.RANDOM, gutter_nm=0, seed=1) -> Panel:
    drawn = np.random.default_rng(seed).integers(8, size=(count, count))
    turned = drawn if tiling is Tiling.RANDOM else np.zeros_like(drawn)
    opening = Opening("slit", mask, dot_nm)
    emitters = Emitters(labels, len(mask) * dot_nm // len(labels))
    return Panel(opening, dot_nm, gutter_nm, turned.astype(np.int8), tiling, seed, emitters)


@pytest.fixture
def slit_panel() -> Callable[..., Panel]:
    return slit


@pytest.fixture
def make_panel() -> Callable[..., Panel]:
    return panel_of


@pytest.fixture
def telephone() -> Viewing:
    """300 pixels per inch at 300 mm."""
    return Viewing(INCH_UM / 300, 300e3)
