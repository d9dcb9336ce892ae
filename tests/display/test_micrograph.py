"""The mean cell of microscope pictures whose truth is known."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from micrograph_simulator import Cell, Microscope, mirrored, of_mask, rounded

import maskfab as mf
from maskfab.base import resources
from maskfab.base.errors import OpeningError
from maskfab.display.lattice import find_lattice
from maskfab.display.micrograph import SeenCell, seen_cell
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import load_opening

PITCH_UM = 40.0
ASKEW = rounded(0.5, 0.5, 0.1, 0.5)


def seen(cell: Cell, *, pixels: int | None = None, side: float = 90, view=(300, 380), seed=0, **faults) -> SeenCell:
    """What is read of a picture of cells of so many pixels."""
    scope = Microscope(side / PITCH_UM, **{"turn_deg": 1.5, "perspective": 0.01, **faults})
    light = scope.light(cell, PITCH_UM, view, np.random.default_rng(seed))
    return seen_cell(light, PITCH_UM, "bright" if scope.transmitted else "dark", pixels, "photo.png")


def ratio_of(cell: Cell, across: int = 1) -> float:
    at = (np.arange(1200 * across) + 0.5) / 1200
    return float(cell(*np.meshgrid(at, at)).mean())


@pytest.mark.parametrize("transmitted", [False, True])
def test_a_rounded_opening_is_read_within_its_bars(transmitted):
    found = seen(rounded(), transmitted=transmitted, uneven=0.3, turn_deg=-2.5, perspective=0.02)
    assert found.pixels == 1
    assert abs(found.open_ratio - ratio_of(rounded())) < min(found.open_ratio_bar, 0.01 * found.open_ratio)
    assert abs(found.px_per_um - 90 / PITCH_UM) < found.px_per_um_bar
    assert found.turn_deg == pytest.approx(-2.5, abs=0.3)
    assert 0.7 < found.blur_px < 1.4
    assert found.edge_bar_px < 0.3


def test_dots_of_a_shipped_opening_come_back():
    mask = load_opening(resources.path("layouts/openings/stripe.toml")).mask
    dots = seen(of_mask(mask), side=126, view=(400, 500)).dots(63)
    assert abs(int(dots.sum()) - 9 * int(mask.sum())) <= 0.01 * 9 * mask.sum()
    rows, columns = (np.flatnonzero(dots.any(axis)) for axis in (1, 0))
    assert abs(np.ptp(rows) + 1 - 54) <= 1
    assert abs(np.ptp(columns) + 1 - 15) <= 1


def test_dirt_on_one_cell_does_not_count():
    clean, dirty = (seen(rounded(), dirt=dirt, seed=3) for dirt in (0, 8))
    assert abs(dirty.open_ratio - clean.open_ratio) < 0.004 * clean.open_ratio


@pytest.mark.parametrize(("across", "up"), [(True, False), (False, True), (True, True)])
def test_mirrored_neighbours_make_a_cell_of_two_pixels(across, up):
    cell = mirrored(ASKEW, across=across, up=up)
    found = seen(cell, view=(420, 480), side=80)
    assert found.pixels == 2
    assert abs(found.open_ratio - ratio_of(cell, 2)) < 0.01 * found.open_ratio
    assert found.px_per_um == pytest.approx(2, rel=2e-3)


def test_three_columns_make_one_pixel_or_as_many_as_are_asked_for():
    columns = lambda x, y: rounded()(3 * x % 1, y)  # noqa: E731 - a cell is a function
    found = seen(columns, side=150, view=(360, 420))
    assert (found.pixels, found.periods) == (1, (3, 1))
    assert found.px_per_um == pytest.approx(150 / PITCH_UM, rel=2e-3)
    assert seen(columns, side=150, view=(360, 420), pixels=3).px_per_um == pytest.approx(50 / PITCH_UM, rel=2e-3)


def two_columns(x, y):
    return rounded()(2 * x % 1, y)


def turned_at_random(x, y):
    kinds = np.random.default_rng(0).integers(0, 8, (64, 64))
    kind, u, v = kinds[np.floor(y).astype(int) % 64, np.floor(x).astype(int) % 64], x % 1, y % 1
    u, v = np.where(kind & 1, 1 - u, u), np.where(kind & 2, 1 - v, v)
    return ASKEW(np.where(kind & 4, v, u), np.where(kind & 4, u, v))


@pytest.mark.parametrize(
    ("cell", "faults", "code", "said"),
    [
        (rounded(), {"view": (150, 160)}, "MF208", "periods are in view; their mean needs 2 x 2"),
        (rounded(), {"bright": 1.3, "uneven": 0.0}, "MF210", "bright places are full"),
        (rounded(), {"dark": -0.3, "uneven": 0.0}, "MF210", "dark places are black"),
        (rounded(), {"blur_px": 16.0}, "MF20[79]", "neither clear nor opaque|shows its level|single periods differ"),
        (lambda x, y: (x % 1 < 0.97) & (y % 1 < 0.97), {"blur_px": 1.5}, "MF209", "shows its level|gaps"),
        (lambda x, y: x % 1 < 0.4, {}, "MF20[78]", "does not repeat|are in view"),
        (lambda x, y: x > 1e9, {}, "MF20[78]", "does not repeat|are in view"),
        (turned_at_random, {"view": (420, 480), "side": 80}, "MF207", "single periods differ"),
        (two_columns, {"side": 120}, "MF211", r"2 x 1 periods"),
        (lambda x, y: rounded()(x / 1.2, y), {}, "MF211", "1.2.. times as wide"),
    ],
)
def test_what_shows_no_cell_is_refused_with_a_cure(cell, faults, code, said):
    with pytest.raises(OpeningError, match=said) as refused:
        seen(cell, **faults)
    assert re.fullmatch(code, refused.value.code)
    assert refused.value.cure


def test_the_cure_of_two_columns_works():
    assert seen(two_columns, side=120, pixels=1).px_per_um == pytest.approx(3, rel=2e-3)
    assert seen(two_columns, side=120, pixels=2).px_per_um == pytest.approx(1.5, rel=2e-3)


def test_the_lattice_lies_within_a_twentieth_of_a_pixel_over_all_the_view():
    view = 330, 400
    scope = Microscope(2.0, turn_deg=2.0, perspective=0.03, uneven=0.3, noise=0.03)
    lattice = find_lattice(scope.light(rounded(), PITCH_UM, view, np.random.default_rng(4)))
    rows, columns = view
    x, y = (part.ravel() for part in np.meshgrid(np.linspace(0, columns - 1, 5), np.linspace(0, rows - 1, 5)))
    right, up = x + 0.5 - columns / 2, rows / 2 - y - 0.5
    depth, turn = 1 + 0.03 * (0.7 * right / columns + 0.5 * up / rows), np.deg2rad(2.0)
    flat = np.stack([right, up]) / depth / 80
    wanted = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) @ flat
    apart = np.stack(lattice.periods(x, y)) - wanted
    assert np.abs(apart - apart.mean(axis=1, keepdims=True)).max() * 80 < 0.1


@pytest.fixture(scope="module")
def photograph(tmp_path_factory) -> Path:
    """A picture of 2 x 2 pixels and more, as a JPEG."""
    scope = Microscope(2.25, turn_deg=1.0, quality=92)
    path = tmp_path_factory.mktemp("seen") / "panel"
    return scope.photograph(path, rounded(), PITCH_UM, (300, 380), np.random.default_rng(2))


def test_a_photograph_becomes_an_opening_and_a_job(photograph, tmp_path):
    made = mf.new(tmp_path / "phone", micrograph=photograph, pitch="40 um")
    assert {path.name for path in made.files} == {"job.toml", "phone.toml", "outline.png"}
    assert all(path.is_file() for path in made.files)
    opening = mf.read_opening(tmp_path / "phone/phone.toml")
    assert opening.pitch_um == 40
    assert opening.open_ratio == pytest.approx(made.seen.open_ratio, abs=1e-3)
    assert opening.provenance["open_ratio_bar"] > 0
    assert "±" in str(made)
    assert set(made.to_dict()) >= {"px_per_um", "px_per_um_bar", "turn_deg", "edge_bar_um", "cells", "cells_differ"}
    assert [die.name for die in load_job(made.job).plate().dies] == ["PHONE"]
