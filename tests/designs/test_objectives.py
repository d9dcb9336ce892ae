"""Objectives: true gradients, sums that share one transform, and what each is blind to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from estimates import surrogate
from once import leaves
from sweeps import in_turns, sweep

from maskfab.base.errors import InputError
from maskfab.camera.protocol import EPSILONS
from maskfab.camera.scenes import Photograph
from maskfab.camera.stop_cells import lay, pupil_transfer
from maskfab.designs.descent.losses import (
    FEW_EPSILONS,
    ExpectedError,
    TopResidual,
    expected_error,
    top_residual,
)
from maskfab.designs.descent.objective import (
    AreaPenalty,
    Autocorrelation,
    Objective,
    TiledStop,
    Weighted,
    invertibility_of,
    tiled_stop,
)
from maskfab.designs.model.expected_psnr import Surrogate
from maskfab.job.camera import Camera, Stop

DOTS = 7
SMALL = Camera(1000.0, Stop("circle", 400.0), (610.0, 530.0, 470.0), 2.0, 256.0)
CELLS = np.random.default_rng(3).integers(8, size=(8, 8)).astype(np.int8)
RANDOM24 = np.random.default_rng(0).integers(8, size=(24, 24)).astype(np.int8)


def small_stop(camera: Camera = SMALL) -> TiledStop:
    return tiled_stop(DOTS, 8000, CELLS, camera, precision="float64")


def unit_of(seed: int, dots: int = DOTS) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).random((dots, dots)))


@pytest.fixture(scope="module")
def scenes() -> tuple[Photograph, ...]:
    return leaves(1), leaves(2)


@pytest.fixture(scope="module")
def known(scenes: tuple[Photograph, ...]) -> Surrogate:
    return surrogate(scenes)


@pytest.fixture(scope="module")
def error(known: Surrogate) -> ExpectedError:
    return expected_error(known, RANDOM24, precision="float64")


def small_residual(**change: object) -> TopResidual:
    scene = Photograph("noise", 1, np.random.default_rng(8).random((3, 96, 96)).astype(np.float32))
    options = {"side": 32, "margin": 16, "crops": 3, "batch": 2, **change}
    return top_residual(small_stop(), [scene], **options)  # type: ignore[arg-type]


def slopes_agree(objective: Objective, unit: torch.Tensor, *, step: float = 1e-6, within: float = 1e-5) -> None:
    leaf = unit.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(objective(leaf), leaf)
    draw = np.random.default_rng(0)
    for _ in range(3):
        way = torch.from_numpy(draw.standard_normal(unit.shape))
        with torch.no_grad():
            slope = (objective(unit + step * way) - objective(unit - step * way)) / (2 * step)
        assert float((gradient * way).sum()) == pytest.approx(float(slope), rel=within, abs=1e-10)


@pytest.mark.parametrize("own_sum", [False, True])
def test_invertibility_on_a_shared_stop_has_a_true_gradient(own_sum: bool) -> None:
    slopes_agree(invertibility_of(small_stop(), own_sum=own_sum), unit_of(0))


@pytest.mark.parametrize("change", [{}, {"beyond": "dark"}])
def test_residuals_have_a_true_gradient(change: dict[str, object]) -> None:
    slopes_agree(small_residual(**change), unit_of(2), within=1e-4)


def test_expected_error_has_a_true_gradient(error: ExpectedError) -> None:
    slopes_agree(error, 0.2 + 0.3 * unit_of(4, 21), within=1e-4)


def test_a_sum_is_the_sum_of_its_terms_and_transforms_once(monkeypatch: pytest.MonkeyPatch) -> None:
    stop = small_stop()
    terms = ((2.0, invertibility_of(stop)), (-0.5, invertibility_of(stop, own_sum=True)), (3.0, AreaPenalty(0.3, 7.0)))
    unit = unit_of(6)
    alone = sum(weight * float(term(unit)) for weight, term in terms)
    called: list[int] = []
    transform = Autocorrelation.__call__

    def counted(self: Autocorrelation, cell: torch.Tensor) -> torch.Tensor:
        called.append(1)
        return transform(self, cell)

    monkeypatch.setattr(Autocorrelation, "__call__", counted)
    assert float(Weighted(terms)(unit)) == pytest.approx(alone, rel=1e-12)
    assert len(called) == 1
    with pytest.raises(InputError):
        Weighted(())


def test_the_area_is_led_down_by_a_slope_or_by_stairs() -> None:
    slope = AreaPenalty(0.2, 1.0, settled=0.5)
    assert [round(slope.wanted(k, 101), 3) for k in (0, 25, 50, 75, 100)] == [1.0, 0.6, 0.2, 0.2, 0.2]
    # Published: 0.05 every five of 150 epochs, down to 0.2.
    stairs = AreaPenalty(0.2, 10.0, settled=80 / 150, stair=0.05)
    for epoch in range(150):
        assert stairs.wanted(6 * epoch, 900) == pytest.approx(max(0.2, 1 - 0.05 * (epoch // 5)))
        assert stairs.wanted(6 * epoch + 5, 900) == pytest.approx(max(0.2, 1 - 0.05 * (epoch // 5)))
    assert stairs.at(-1, 900).now == 0.2
    assert float(stairs.at(0, 900)(torch.full((3, 3), 0.7))) == pytest.approx(10 * 0.3**2)


def test_darkness_is_free_for_the_published_loss_but_not_for_the_others(error: ExpectedError) -> None:
    stop, unit = small_stop(), unit_of(9)
    blind = invertibility_of(stop, own_sum=True)
    assert float(blind(0.5 * unit)) == pytest.approx(float(blind(unit)), rel=1e-9)
    energy_true = invertibility_of(stop)
    assert float(energy_true(0.5 * unit)) > float(energy_true(unit)) + 0.01
    large = unit_of(9, 21)
    assert float(error(0.5 * large)) > float(error(large)) + 0.5


def test_grey_is_the_optimum_of_the_published_loss_and_only_of_that() -> None:
    """Any pattern of the same mean is worse than grey when darkness is free; holes beat equally dark grey when not."""
    stop = small_stop()
    published, energy_true = invertibility_of(stop, own_sum=True), invertibility_of(stop)
    grey = torch.full((DOTS, DOTS), 0.2, dtype=torch.float64)
    for seed in range(20):
        mask = torch.from_numpy(np.random.default_rng(seed).permutation(49).reshape(7, 7) < 10).double()
        assert float(published(mask)) > float(published(grey)) + 0.05
    assert float(published(grey)) == pytest.approx(float(published(torch.ones_like(grey))), rel=1e-9)
    assert float(energy_true(grey)) > float(energy_true(torch.ones_like(grey))) + 0.05


def test_grid_transfer_is_that_of_the_protocol() -> None:
    """Apart from what sampling folds back, which the protocol adds: compare where its orders reach beyond the stop."""
    camera = Camera(10_000.0, Stop("circle", 2 * 250 / 504 * 4032.0), (610.0, 530.0, 470.0), 2.0, 256.0)
    stop = tiled_stop(21, 8000, RANDOM24, camera, precision="float64")
    unit = np.random.default_rng(2).random((21, 21)) < 0.3
    table = stop.correlation(torch.from_numpy(unit.astype(np.float64)))
    found = stop.on_grid((64, 96))(table).numpy()
    laid = lay("x", unit, RANDOM24)
    assert stop.share(table) == pytest.approx(laid.transmission)
    expected = pupil_transfer(laid.pupil, laid.lattice, (64, 96))
    assert found.shape == expected.shape
    low = abs(np.fft.fftfreq(64))[:, None] + np.fft.rfftfreq(96) < 0.1
    np.testing.assert_allclose(found[:, low], expected[:, low], atol=0.02)
    assert found[:, 0, 0] == pytest.approx(1.0)


@pytest.fixture(scope="module")
def every(known: Surrogate) -> ExpectedError:
    """With all constants of the protocol."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("maskfab.designs.descent.losses.FEW_EPSILONS", EPSILONS)
        return expected_error(known, RANDOM24, precision="float64")


def test_expected_error_is_the_surrogates_for_one_layout(known: Surrogate, every: ExpectedError) -> None:
    objective = every
    draw = np.random.default_rng(4)
    ours, theirs = [], []
    for _ in range(6):
        top, left, height, width = draw.integers(0, 5), draw.integers(0, 5), draw.integers(6, 16), draw.integers(5, 16)
        unit = np.zeros((21, 21), dtype=np.bool_)
        unit[top : top + height, left : left + width] = True
        errors = objective.errors(objective.correlation(torch.from_numpy(unit.astype(np.float64))))
        ours.append((-10 * torch.log10(errors)).numpy())
        theirs.append(known(unit))
    np.testing.assert_allclose(ours, theirs, atol=0.5)
    assert abs(np.mean(np.subtract(ours, theirs))) < 0.25


def test_fewer_constants_cost_little(every: ExpectedError, error: ExpectedError) -> None:
    unit = (unit_of(10, 21) < 0.25).double()
    assert 0 <= float(error(unit)) - float(every(unit)) < 0.05
    assert len(FEW_EPSILONS) == 8


def test_a_half_turn_of_the_whole_panel_changes_no_table() -> None:
    stop, unit = small_stop(), unit_of(11)
    turned = replace(stop.correlation, index=stop.correlation.index.flip(0))
    torch.testing.assert_close(stop.correlation(unit), turned(unit))


def test_batches_are_a_pass_over_all_crops_and_follow_from_the_step() -> None:
    objective = small_residual(crops=5, batch=2)
    assert objective.batches == 3
    for epoch in (0, 7):
        chosen = [objective.at(3 * epoch + k, 30).chosen for k in range(3)]
        assert sorted(sum(chosen, ())) == [0, 1, 2, 3, 4]
        assert chosen == [objective.at(3 * epoch + k, 30).chosen for k in range(3)]
    assert objective.at(-1, 30).chosen == (0, 1, 2, 3, 4)


def test_an_open_cell_leaves_less_than_half_of_its_dots() -> None:
    unit = (unit_of(12) < 0.5).double()
    bare = torch.ones_like(unit)
    assert float(small_residual()(bare)) < float(small_residual()(unit))


def test_the_largest_tenth_is_above_the_mean(monkeypatch: pytest.MonkeyPatch) -> None:
    unit = unit_of(13)
    largest = float(small_residual()(unit))
    monkeypatch.setattr("maskfab.designs.descent.losses.LARGEST", 1.0)
    assert largest > 2 * float(small_residual()(unit))


def test_scenes_smaller_than_a_crop_are_refused() -> None:
    with pytest.raises(InputError, match=r"MF104.*128 x 128 pixels, and a scene only 96"):
        small_residual(side=96)


def test_more_refusals() -> None:
    with pytest.raises(InputError) as caught:
        top_residual(small_stop(), [])
    assert caught.value.code == "MF105"
    with pytest.raises(InputError) as caught:
        tiled_stop(DOTS, 8000, CELLS, replace(SMALL, pixel_um=100.0))
    assert caught.value.code == "MF104"


@pytest.mark.parametrize(
    ("diameter", "wavelengths"), sweep(in_turns((400.0, 40.0), [(530.0,), tuple(np.linspace(400, 700, 31))]), 2)
)
def test_one_line_or_many_and_a_stop_within_one_cell(wavelengths: tuple[float, ...], diameter: float) -> None:
    cells = CELLS[:1, :1] if diameter < 56 else CELLS
    camera = Camera(1000.0, Stop("circle", diameter), wavelengths, 2.0, 256.0)
    stop = tiled_stop(DOTS, 8000, cells, camera, precision="float64")
    slopes_agree(invertibility_of(stop), unit_of(15))
