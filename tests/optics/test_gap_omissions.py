"""What leaving out a gap is said to cost, for every tiling, against the moved and the propagated PSF."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from optics_cases import camera, noise, panel, pupil, shifted_psf
from scipy.special import fresnel

from maskfab.base.model import Opening, Panel, Psf, Tiling
from maskfab.job.camera import Camera, Stop
from maskfab.mask.panels import hexagonal_sheet
from maskfab.optics.gap import gap_psf, moved_pupil, rim_crowding
from maskfab.optics.metrics import relative_difference
from maskfab.optics.phase import defocus_waves, phased, phased_psf, window_frequency
from maskfab.optics.psf import point_psf
from maskfab.optics.pupil import Aperture, cut, panel_aperture
from maskfab.optics.scene.omissions import estimate
from maskfab.optics.scene.plan import cost_model
from maskfab.optics.scene.scene import Scene
from maskfab.optics.stop import edge_points, perimeter_um
from maskfab.optics.tiling import orientations
from maskfab.optics.tiling_mean import layout_psf, mean_psf

LINE = 530.0


def spot(dots: int, row: int, column: int, rows: int, columns: int) -> np.ndarray:
    mask = np.zeros((dots, dots), dtype=np.bool_)
    mask[row : row + rows, column : column + columns] = True
    return mask


ANGLE = spot(21, 3, 4, 15, 2) | spot(21, 3, 4, 2, 11)
MASKS = {
    "spot": spot(21, 2, 13, 4, 4),
    "angle": ANGLE,
    "low spot": spot(21, 1, 9, 2, 4),
    "noise": noise(15, 0.1, 8),
    "dense": noise(7, 0.6, 4),
}
TILINGS = ("random", "map", "halves", "blue_noise", "hexagonal", "others", "others turned", "rot90", "periodic")


def laid(tiling: str, mask: np.ndarray, width_um: float, seed: int = 1) -> Panel:
    """A panel at least that wide of dots of 8 um."""
    dots = mask.shape[0]
    cells = 2 * math.ceil(width_um / (16.0 * dots))
    draw = np.random.default_rng(seed)
    opening, others = Opening("a", mask, 8000), (Opening("b", noise(dots, 0.3, 77), 8000),)
    if tiling == "hexagonal":
        sheet = hexagonal_sheet(opening, cells * dots, seed)
        return Panel(sheet, 8000, 0, np.zeros((1, 1), dtype=np.int8), Tiling.HEXAGONAL, seed)
    kind = {"halves": "map", "others": "periodic", "others turned": "rot90"}.get(tiling, tiling)
    if tiling == "map":
        chosen = draw.integers(8, size=(cells, cells))
    elif tiling == "halves":
        chosen = np.where(np.arange(cells) < cells // 2, 0, 5) * np.ones((cells, 1), dtype=int)
    else:
        chosen = orientations(Tiling(kind), cells, cells, seed, openings=2 if "others" in tiling else 1)
    held = others if "others" in tiling else ()
    return Panel(opening, 8000, 0, chosen.astype(np.int8), Tiling(kind), seed, others=held)


def check(tiling: str, mask: str, shape: str, diameter_um: float, gap_um: float, field_um: float) -> None:
    setting = camera(diameter_um, "square" if shape == "square" else "circle", (LINE,), 96.0)
    design = laid(tiling, MASKS[mask], diameter_um + 120)
    clear, source = panel_aperture(design), pupil(design, setting.stop)
    plain = point_psf(source, setting, LINE)
    found = estimate(design, source, setting, Scene(gap_um=gap_um, field_um=field_um))
    reaches = {"shift": field_um, "3 x 3": field_um * math.sqrt(2) / 2}
    foretold = {"shift": found.shift.error, "3 x 3": found.places[3], "diffraction": found.diffraction.error}
    real = {
        name: max(
            relative_difference(
                plain, shifted_psf(clear, setting, LINE, gap_um, (reach * math.cos(turn), reach * math.sin(turn)))
            )
            for turn in (0.0, 0.9, 2.2)
        )
        for name, reach in reaches.items()
    }
    still, spread = (gap_psf(clear, setting, LINE, gap, samples_per_dot=2) for gap in (0.0, gap_um))
    real["diffraction"] = relative_difference(still, spread)
    for name, error in real.items():
        print(
            f"{tiling:13} {mask:8} {shape} {diameter_um:g} um {name:11} foretold {foretold[name]:.3f} real {error:.3f}"
        )
    assert {name for name, error in real.items() if error > foretold[name]} == set()


@pytest.mark.parametrize(
    ("tiling", "mask", "shape", "diameter_um", "gap_um", "field_um"),
    [
        ("blue_noise", "spot", "circle", 600.0, 100.0, 300.0),
        ("blue_noise", "spot", "circle", 300.0, 400.0, 300.0),
        ("hexagonal", "spot", "circle", 300.0, 100.0, 300.0),
        ("hexagonal", "angle", "square", 500.0, 20.0, 300.0),
        ("map", "angle", "circle", 600.0, 400.0, 100.0),
        ("others", "spot", "square", 400.0, 100.0, 1000.0),
        ("halves", "angle", "circle", 400.0, 100.0, 300.0),
        ("rot90", "low spot", "square", 500.0, 300.0, 200.0),
        ("periodic", "low spot", "circle", 350.0, 50.0, 800.0),
        ("periodic", "spot", "square", 400.0, 300.0, 200.0),
    ],
)
def test_a_gap_costs_no_more_than_foretold(
    tiling: str, mask: str, shape: str, diameter_um: float, gap_um: float, field_um: float
) -> None:
    check(tiling, mask, shape, diameter_um, gap_um, field_um)


@pytest.mark.slow
@pytest.mark.parametrize("tiling", TILINGS)
@pytest.mark.parametrize("mask", ["spot", "angle", "noise"])
@pytest.mark.parametrize(("shape", "diameter_um"), [("circle", 300.0), ("circle", 700.0), ("square", 500.0)])
@pytest.mark.parametrize(("gap_um", "field_um"), [(100.0, 1000.0), (400.0, 100.0)])
def test_a_gap_costs_no_more_than_foretold_anywhere(
    tiling: str, mask: str, shape: str, diameter_um: float, gap_um: float, field_um: float
) -> None:
    check(tiling, mask, shape, diameter_um, gap_um, field_um)


def test_a_layout_tells_the_scatter_of_its_ensemble() -> None:
    """Drawn cell by cell, where the closed form is known; a layout that repeats has none."""
    setting = camera(400.0, window_um=96.0)
    mean = mean_psf(laid("random", ANGLE, 500.0), setting, LINE)
    single = []
    for seed in range(6):
        design = laid("random", ANGLE, 500.0, seed)
        pilot = point_psf(pupil(design, setting.stop), setting, LINE)
        single.append(layout_psf(design, pilot, setting))
    assert np.mean([each.variance.sum() for each in single]) == pytest.approx(mean.variance.sum(), rel=0.3)
    assert np.mean([each.random_share.sum() for each in single]) == pytest.approx(mean.random_share.sum(), rel=0.2)
    repeated = panel(ANGLE, cells=4)
    still = layout_psf(repeated, point_psf(pupil(repeated, setting.stop), setting, LINE), setting)
    assert still.scatter < 1e-12


def crowding(clear: np.ndarray, stop: Stop) -> float:
    """Of dots of 1 um about the axis, for a move by 4 um."""
    lattice = panel_aperture(panel(clear, dot_nm=1000, cells=1))
    openings = Aperture(lattice.x, lattice.y, clear.astype(np.float64), np.zeros(clear.shape))
    return rim_crowding(openings, cut(openings, stop), 4.0)


@pytest.mark.parametrize("shape", ["circle", "square"])
def test_crowding_of_the_rim(shape: str) -> None:
    stop = Stop("square" if shape == "square" else "circle", 100.0)
    place = np.arange(160) - 79.5
    distance = np.maximum(abs(place), abs(place[:, None])) if shape == "square" else np.hypot(place, place[:, None])
    assert crowding(distance < 1000, stop) == pytest.approx(1.0, abs=0.03)
    # Light about the rim only: the whole stop over the part of it that is clear.
    hollow = (100**2 if shape == "square" else np.pi * 50**2) / ((distance > 40) & (distance < 50)).sum()
    assert crowding(distance > 40, stop) == pytest.approx(hollow, rel=0.05)
    assert crowding(distance < 40, stop) == 1.0
    lone = (distance < 10) | ((distance > 30) & (abs(place) < 15) & (place[:, None] > 0))
    turned = [crowding(np.rot90(lone, k), stop) for k in range(4)]
    assert min(turned) > 1.3
    assert max(turned) < 1.05 * min(turned)


@pytest.mark.parametrize(
    "stop",
    [
        Stop("circle", 100.0),
        Stop.ellipse(100.0, 60.0),
        Stop.rectangle(40.0, 100.0),
        Stop.annulus(100.0, 30.0),
        Stop.polygon([(-50, -40), (50, -40), (0, 45)]),
    ],
    ids=lambda stop: stop.shape,
)
def test_edge_points_close_and_hold_the_stops_area(stop: Stop) -> None:
    place, outward, length = edge_points(stop, 600)
    np.testing.assert_allclose(np.hypot(*outward.T), 1, rtol=1e-12)
    np.testing.assert_allclose(length @ outward, 0, atol=1e-9)
    assert length @ (place * outward).sum(axis=1) / 2 == pytest.approx(stop.area_um2, rel=1e-4)
    assert length.sum() == pytest.approx(perimeter_um(stop), rel=1e-3)


def through_a_square(openings: Aperture, side_um: float, gap_um: float, u: np.ndarray) -> tuple[np.ndarray, float]:
    """|field|² at frequencies u along x and y, and the energy: Fresnel integrals dot by dot, axis by axis."""
    nodes, weights = leggauss(64)
    panels = 64
    place = side_um / 2 * (((nodes + 1) / 2 + np.arange(panels)[:, None]) / panels * 2 - 1).ravel()
    weight = np.tile(weights * side_um / (2 * panels), panels)
    scale, waves = np.sqrt(2 / (LINE * 1e-3 * gap_um)), []
    for lattice in (openings.y, openings.x):
        sine, cosine = fresnel(scale * (lattice.edges_um()[:, None] - place))
        waves.append(np.diff((cosine + 1j * sine) / np.sqrt(2j), axis=0))
    up, across = (each @ (weight[:, None] * np.exp(-2j * np.pi * place[:, None] * u)) for each in waves)
    grams = [(each * weight) @ each.conj().T for each in waves]
    clear = openings.transmission
    energy = np.einsum("ji,jl,lk,ik->", clear, grams[0], clear, grams[1], optimize=True)
    return abs(up.T @ clear @ across) ** 2, float(energy.real)


ONE, FEW = spot(3, 1, 1, 1, 1), spot(7, 2, 3, 1, 1) | spot(7, 5, 1, 1, 1)


@pytest.mark.parametrize(
    ("mask", "dot_nm", "side_um", "gap_um"),
    [
        (ONE, 40_000, 400.0, 100.0),
        (ONE, 60_000, 240.0, 500.0),
        (FEW, 40_000, 400.0, 200.0),
        (FEW, 16_000, 320.0, 300.0),
    ],
)
def test_samples_in_a_square_stop_err_no_more_than_stated(
    mask: np.ndarray, dot_nm: int, side_um: float, gap_um: float
) -> None:
    """Sparse dots whose edges fall on the stop's, where samples err most."""
    cells = 2 * math.ceil((side_um + 200) / (2e-3 * dot_nm * mask.shape[0]))
    laid_out, setting = panel(mask, dot_nm=dot_nm, cells=cells), camera(side_um, "square", (LINE,), 96.0)
    clear = panel_aperture(laid_out)
    known = cost_model(laid_out, setting, Scene(gap_um=gap_um), 0.1)
    stated = {each.samples_per_dot: known.own_error(each) for each in known.choices() if each.diffraction}
    expected = None
    for samples in sorted(stated)[:3]:
        found = gap_psf(clear, setting, LINE, gap_um, samples_per_dot=samples)
        if expected is None:
            scale = LINE * 1e-3 * setting.focal_um
            reach = found.values.shape[0] // 2
            intensity, energy = through_a_square(
                clear, side_um, gap_um, found.step_um * np.arange(-reach, reach + 1) / scale
            )
            expected = intensity / (scale**2 * energy)
        real = np.linalg.norm(found.values - expected) / np.linalg.norm(expected)
        print(f"{dot_nm} nm {side_um:g} um {samples} samples: stated {stated[samples]:.1e} real {real:.1e}")
        assert real <= stated[samples]


@pytest.mark.parametrize(("scene", "laid_out"), [(Scene(), 0), (Scene(field_um=200.0, gap_um=500.0), 1)])
def test_openings_beside_the_stop_are_laid_out_once_for_what_moves_or_spreads_only(
    monkeypatch: pytest.MonkeyPatch, scene: Scene, laid_out: int
) -> None:
    asked: list[float] = []

    def counted(design: Panel, half_width_um: float) -> Aperture:
        asked.append(half_width_um)
        return panel_aperture(design, half_width_um)

    monkeypatch.setattr("maskfab.optics.scene.omissions.panel_aperture", counted)
    found = cost_model(panel(noise(5, 0.5, 1), cells=60, seed=3), camera(300.0), scene, 0.1).estimates
    assert (len(asked), all(width > 150.0 for width in asked)) == (laid_out, True)
    assert found.crowding >= 1


@pytest.mark.parametrize("scenes", [range(3), pytest.param(range(3, 43), marks=pytest.mark.slow)], ids=["3", "40"])
def test_a_short_move_errs_no_more_than_is_said_and_not_much_less(scenes: range) -> None:
    """Against PSFs moved in directions and between places that were not tried."""
    ratios = []
    for scene in scenes:
        draw = np.random.default_rng(scene)
        shape, diameter, dots = draw.choice(["circle", "square"]), float(draw.choice([200, 350, 600])), 5 + scene % 9
        dot, gutter, moved = int(draw.choice([2000, 8000])), int(draw.choice([0, 6000])), float(draw.uniform(0.1, 0.2))
        setting, blurred = camera(diameter, shape, window_um=96.0), float(draw.uniform(0.3, 0.98))
        pitch = (dots * dot + gutter) / 1e3
        # The gap blurs by that share of a dot.
        gap = (blurred * dot / 1e3) ** 2 / (LINE / 1e3)
        reach = min(2000.0, moved * pitch * setting.focal_um / gap)
        laid_out = panel(
            noise(dots, draw.uniform(0.2, 0.8), scene),
            dot_nm=dot,
            gutter_nm=gutter,
            cells=2 * math.ceil(diameter / 2 / pitch + 3),
            seed=scene if scene % 2 else None,
        )
        found = estimate(laid_out, pupil(laid_out, setting.stop), setting, Scene(gap_um=gap, field_um=reach))
        openings = panel_aperture(laid_out)

        def seen(x: float, y: float, openings: Aperture = openings, setting: Camera = setting, gap: float = gap) -> Psf:
            return shifted_psf(openings, setting, LINE, gap, (x, y))

        axis, angles = seen(0.0, 0.0), np.pi * np.concatenate([np.arange(8) / 4, draw.uniform(0, 2, 10)])
        true = [
            relative_difference(axis, seen(part * reach * math.cos(angle), part * reach * math.sin(angle)))
            for angle in angles
            for part in (1.0, 0.6)
        ]
        assert max(true) <= found.shift.error
        # Gutters on the rim: what moves there is dark.
        if max(true) > 1e-9:
            ratios.append(found.shift.error / max(true))
        for places, error in found.places.items():
            for _ in range(4 if error else 0):
                away, part, angle = reach / (places - 1), draw.uniform(0, 0.9), draw.uniform(0, 2 * np.pi)
                x, y = part * reach * math.cos(angle), part * reach * math.sin(angle)
                dx, dy = draw.uniform(-away, away, 2)
                if math.hypot(x + dx, y + dy) <= reach:
                    assert relative_difference(seen(x, y), seen(x + dx, y + dy)) <= error
    assert max(ratios) <= 3


@pytest.mark.parametrize("aberrations", [(), ((4, 0.2),)], ids=["near", "aberrated"])
def test_a_move_against_a_phase_errs_no_more_than_is_said(aberrations: tuple[tuple[int, float], ...]) -> None:
    """A shadow that moves against a defocus moves the image, which it does not in focus."""
    setting, laid_out = camera(800.0, window_um=96.0), panel(noise(15, 0.5, 3), cells=16)
    nearest = math.inf if aberrations else 3e5
    scene = Scene(nearest_um=nearest, gap_um=500.0, field_um=500.0, aberrations=aberrations)
    found = estimate(laid_out, pupil(laid_out, setting.stop), setting, scene)
    openings = panel_aperture(laid_out)
    lens, blur = scene.wavefront(setting), defocus_waves(setting, LINE, nearest, math.inf)

    def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return lens.waves(setting.stop, LINE)(x, y) + blur(x, y)

    still, moved = (
        phased_psf(
            phased(moved_pupil(openings, setting.stop, by), waves, window_frequency(setting, LINE)), setting, LINE
        )
        for by in ((0.0, 0.0), (25.0, 0.0))
    )
    assert relative_difference(still, moved) <= found.shift.error
