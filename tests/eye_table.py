"""What makes an even field uneven, by experiments that change one thing at a time: ``python tests/eye_table.py``.

Every row is a display of pixels 168 um wide: ΔE of an even field from 300 and from 600 mm, slow grain from 300 mm, the
footprint of each colour, and its life over that of a panel of today. Fields draw their orientations unless a row says
otherwise; numbers are of the closed form, or of a picture of 100 x 100 pixels where that is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from maskfab.base.arrays import Floats, Labels
from maskfab.base.model import Emitters, Opening, orient
from maskfab.display import emitter_pieces
from maskfab.display.drive import LightDemand, current_density, relative_life
from maskfab.display.emitted_light import EmittedLight, Viewing, series, tiles_of
from maskfab.display.emitter_pieces import in_pieces, look, pieces_bound
from maskfab.display.emitter_rules import EmitterRules, grid_of
from maskfab.display.evenness import evenness
from maskfab.display.eye import HIGHEST_CPD, SLOW_CPD, measured_rms, of_series
from maskfab.display.feasibility import REFERENCE_SHARE, displays
from maskfab.display.free_area import EVERY, free_region
from maskfab.display.placement import centred, footprint
from maskfab.mask.job import load_job
from maskfab.mask.opening_file import load_opening
from maskfab.optics.colour import lab_of_linear_srgb

LAYOUTS = Path(__file__).parents[1] / "layouts"
DOT_NM, PITCH_UM = 8000, 168.0
RULES = EmitterRules(4000, 8000, 8000)
NEAR, FAR = (Viewing(PITCH_UM, distance) for distance in (300e3, 600e3))

Row = tuple[str, float, float, float, float | None]
"""What; ΔE near and far; slow grain near; footprint, if there is one."""


def rows() -> Iterator[Row]:
    yield from of_fits()
    yield from without_opening()
    yield from unturned()
    yield from of_pieces()


def of_fits() -> Iterator[Row]:
    """The display that fits, whole emitters, one thing changed at a time."""
    built = displays(load_job(LAYOUTS / "display_that_fits.toml"))
    panel = next(die.panel for die in built.plate.dies if die.name == "FITS")
    panel = replace(panel, emitters=whole(panel.opening))
    tiles, drawn = (
        np.stack([tile.samples(14) for tile in tiles_of(panel)]),
        np.random.default_rng(0).integers(8, size=(100, 100)),
    )
    share = footprint_of(panel.emitters)
    yield "fits, each colour one area, as mapped (picture)", *pictured(tiles, panel.orientations), share
    yield "the same, orientations drawn (picture)", *pictured(tiles, drawn), share
    closed = [evenness(panel, viewing) for viewing in (NEAR, FAR)]
    yield "the same, closed form", closed[0].delta_e, closed[1].delta_e, closed[0].grain, share
    yield "the same pixel, not turned (picture)", *pictured(tiles, drawn * 0), share
    grey = np.tensordot(np.array([0.2126, 0.7152, 0.0722]), tiles, axes=(0, 1))[:, None].repeat(3, axis=1)
    yield "turned, its luminance without its colours (picture)", *pictured(grey, drawn), None


def without_opening() -> Iterator[Row]:
    """What turning does with no opening in the way."""
    labels = np.zeros((42, 42), dtype=np.int8)
    for colour in range(3):
        labels[1:-1, 14 * colour + 1 : 14 * colour + 13] = colour + 1
    yield row("three stripes, no opening, turned", labels)
    nothing = Opening("nothing", np.zeros((21, 21), dtype=np.bool_), DOT_NM)
    placed = pieces(nothing, 0.2)
    if placed is not None:
        yield row("several pieces, no opening, turned", placed.labels)


def unturned() -> Iterator[Row]:
    """Emitters that do not turn keep clear of the opening in all orientations."""
    for name in ("fits", "fits_88", "bar", "density", "toled"):
        opening = load_opening(LAYOUTS / f"openings/{name}.toml")
        union = replace(opening, mask=np.any([orient(opening.mask, k) for k in EVERY], axis=0), emitters=None)
        grid = grid_of(union, DOT_NM, 0, RULES)
        found = footprint(union, DOT_NM, 0, EVERY, RULES, largest=True)
        bound, _ = pieces_bound(free_region(union.mask, grid), grid, RULES.ratio)
        most = bound * (grid.cell_nm / grid.pitch_nm) ** 2
        what = f"{name}, not turned: at most {most:.1%} for each colour, in however many pieces"
        if found.best is None:
            yield what, np.nan, np.nan, np.nan, 0.0
            continue
        still = np.repeat(found.best.labels[None], 1, axis=0)
        seen = [emitter_pieces.look(Emitters(still[0], grid.cell_nm), grid.pitch_nm, (0,), v) for v in (NEAR, FAR)]
        yield what, seen[0].delta_e, seen[1].delta_e, seen[0].grain, footprint_of(found.best)


def of_pieces() -> Iterator[Row]:
    """The area that evenness costs."""
    for name, shares in {
        "fits": (0.129, 0.15, 0.17, 0.18),
        "fits_88": (0.129, 0.17),
        "bar": (0.129, 0.17),
        "density": (0.129, 0.09, 0.05),
    }.items():
        opening = of_panel(name)
        yield row(f"{name}, each colour one area", whole(opening).labels)
        for share in shares:
            placed = pieces(opening, share)
            if placed is None:
                yield f"{name}, several pieces of {share:.1%}: none found", np.nan, np.nan, np.nan, None
            else:
                yield row(f"{name}, several pieces", placed.labels)


def of_panel(name: str) -> Opening:
    """An opening, with what cells beside it hold: emitters are alike in all of them."""
    opening = load_opening(LAYOUTS / f"openings/{name}.toml")
    outer = LAYOUTS / f"openings/{name}_outer.toml"
    if not outer.exists():
        return replace(opening, emitters=None)
    return replace(opening, mask=opening.mask | load_opening(outer).mask, emitters=None)


def whole(opening: Opening) -> Emitters:
    """Emitters as a display draws them that keeps three quarters of the largest footprint."""
    grid = grid_of(opening, DOT_NM, 0, RULES)
    found = footprint(opening, DOT_NM, 0, EVERY, RULES, largest=True)
    cells = np.random.default_rng(0).integers(8, size=(50, 50)).astype(np.int8)
    placed = centred(found.best, opening, grid, cells, RULES, keep=0.75)
    if placed is None:
        raise ValueError(f"no emitters fit {opening.name}")
    return placed


def pieces(opening: Opening, share: float) -> Emitters | None:
    grid = grid_of(opening, DOT_NM, 0, RULES)
    return in_pieces(opening, grid, EVERY, RULES.ratio, share * (grid.pitch_nm / grid.cell_nm) ** 2, NEAR)


def row(what: str, labels: Labels) -> Row:
    emitters = Emitters(labels, 21 * DOT_NM // len(labels))
    near, far = (look(emitters, 21 * DOT_NM, EVERY, viewing) for viewing in (NEAR, FAR))
    return what, near.delta_e, far.delta_e, near.grain, footprint_of(emitters)


def footprint_of(emitters: Emitters) -> float:
    return min(emitters.areas_um2) / PITCH_UM**2


def pictured(tiles: Floats, cells: Labels) -> tuple[float, float, float]:
    """ΔE from near and far, and slow grain, of a picture."""
    rows_, columns = cells.shape
    samples = tiles.shape[-1]
    rgb = 0.5 * tiles[cells % 8].transpose(2, 0, 3, 1, 4).reshape(3, rows_ * samples, columns * samples)
    seen = []
    for viewing in (NEAR, FAR):
        spectrum = series(EmittedLight(rgb, samples, PITCH_UM), viewing, HIGHEST_CPD)
        off = of_series(spectrum, viewing) - lab_of_linear_srgb(np.full(3, 0.5))
        seen.append((float(np.linalg.norm(off, axis=-1).mean()), measured_rms(spectrum, 0, SLOW_CPD)))
    return seen[0][0], seen[1][0], seen[0][1]


def life(share: float) -> float:
    """Of a colour, over that of emitters of 9.3 % of the pixel."""
    light = LightDemand()
    own, usual = (current_density(light, (each,) * 3)[0] for each in (share, REFERENCE_SHARE))
    return relative_life(own, usual, light.ageing_exponent)


def main() -> None:
    print("| display | ΔE at 300 mm | at 600 mm | grain, 300 mm | footprint | life |")
    print("| --- | --- | --- | --- | --- | --- |")
    for what, near, far, grain, share in rows():
        area = "" if share is None else f"{share:.1%}"
        lives = f"{life(share):.2f}" if share else ""
        numbers = ["" if np.isnan(value) else text for value, text in
                   ((near, f"{near:.2f}"), (far, f"{far:.2f}"), (grain, f"{grain:.4f}"))]  # fmt: skip
        print(f"| {what} | {' | '.join(numbers)} | {area} | {lives} |", flush=True)


if __name__ == "__main__":
    main()
