"""Gradients of PSF, MTF and restored error by the dots: true, equal to what the camera tells, and refused in words."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

import maskfab as mf
from maskfab.base.errors import InputError, JobError
from maskfab.base.model import Opening, Panel, Tiling, orient
from maskfab.camera.scenes import bundled
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.designs.descent import panel_optics
from maskfab.designs.descent.losses import expected_error
from maskfab.designs.descent.objective import Autocorrelation, tiled_stop
from maskfab.designs.descent.panel_optics import modulation
from maskfab.designs.model.expected_psnr import surrogate_behind
from maskfab.optics.pupil import cut, panel_aperture

SMALL = mf.Camera("1 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
TINY = mf.Camera("1 mm", stop="100 um", pixel="4 um", wavelengths="530 nm", window="32 um")
F1 = mf.Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths=["610 nm", "530 nm", "470 nm"])
RANDOM: dict[str, Any] = {"pitch": "56 um", "tiling": "random", "seed": 1}
COARSE: dict[str, Any] = {"pitch": "168 um", "tiling": "random", "seed": 2}
"""Of three dots a pixel behind F1."""


def grey(dots: int, seed: int = 0, *batch: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).uniform(0.1, 0.9, (*batch, dots, dots)))


def binary(dots: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random((dots, dots)) < 0.4


TINY_ONES: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "psf": lambda dots: mf.torch.psf(dots, TINY, pitch="24 um", tiling="random", seed=1) / 1e-2,
    "psf of pixels": lambda dots: mf.torch.psf(dots, TINY, pitch="26 um", gutter="2 um", pixels=True) / 1e-2,
    "mtf": lambda dots: mf.torch.mtf(dots, TINY, pitch="24 um", tiling="random", seed=1)[..., ::9, ::9],
    "mtf with gutters": lambda dots: mf.torch.mtf(dots, TINY, pitch="26 um", gutter="2 um")[..., ::9, ::9],
}


@pytest.mark.parametrize("name", TINY_ONES)
def test_first_and_second_derivatives_agree_with_differences(name: str) -> None:
    dots = grey(3, 1, 2).requires_grad_()
    assert torch.autograd.gradcheck(TINY_ONES[name], dots, fast_mode=True)
    assert torch.autograd.gradgradcheck(TINY_ONES[name], dots, fast_mode=True)


@pytest.mark.parametrize("tiling", ["random", "periodic"])
def test_fine_dots_that_share_sources_have_true_derivatives(monkeypatch: pytest.MonkeyPatch, tiling: str) -> None:
    monkeypatch.setattr(panel_optics, "_FINE", 2)
    camera = mf.Camera("4 mm", stop="90 um", pixel="4 um", wavelengths="530 nm", window="32 um")
    panel = mf.Panel.tile(binary(6, 3), tiling, seed=1, pitch="24 um", size="120 um")
    function = panel_optics.point_image(panel, camera.model, 530.0)
    assert isinstance(function.spread, panel_optics.Merged)
    dots = grey(6, 1, 2).requires_grad_()
    assert torch.autograd.gradcheck(lambda unit: function(unit) / 1e-3, dots, fast_mode=True)
    assert torch.autograd.gradgradcheck(lambda unit: function(unit) / 1e-3, dots, fast_mode=True)


@pytest.mark.parametrize("stop", ["1 mm", {"shape": "rectangle", "width": "600 um", "height": "1 mm"}])
@pytest.mark.parametrize("pixels", [False, True])
def test_fine_dots_that_share_sources_are_those_that_have_their_own(
    monkeypatch: pytest.MonkeyPatch, stop: Any, pixels: bool
) -> None:
    camera = mf.Camera("10 mm", stop=stop, pixel="2 um", wavelengths="530 nm", window="128 um")
    panel = mf.Panel.tile(binary(48, 5), "random", seed=3, pitch="96 um", size="1.2 mm")

    def taken(shared: bool, dtype: torch.dtype) -> torch.Tensor:
        monkeypatch.setattr(panel_optics, "_FINE", 48 if shared else 49)
        function = panel_optics.point_image(panel, camera.model, 530.0, pixels=pixels, dtype=dtype)
        assert isinstance(function.spread, panel_optics.Merged) is shared
        dots = grey(48, 7).to(dtype).requires_grad_()
        image = function(dots) / float(function(dots).detach().max())
        (slope,) = torch.autograd.grad((grey(len(image), 6).to(dtype) * image**2).sum(), dots)
        return torch.cat([image.detach().flatten(), slope.flatten() / float(slope.abs().max())])

    exact = taken(False, torch.float64)
    assert float((taken(True, torch.float64) - exact).abs().max()) < 1e-12
    single, rounded = (float((taken(shared, torch.float32) - exact).abs().max()) for shared in (True, False))
    assert single < 2 * rounded < 1e-4


def test_the_derivatives_of_the_restored_error_agree_with_differences() -> None:
    def error(dots: torch.Tensor) -> torch.Tensor:
        return mf.torch.restored_error(dots, F1, levels=(24,), decibels=True, **COARSE)

    dots = grey(3, 2).requires_grad_()
    assert torch.autograd.gradcheck(error, dots, fast_mode=True)
    assert torch.autograd.gradgradcheck(error, dots, fast_mode=True)


@pytest.mark.parametrize(
    ("stop", "pitch", "gutter"),
    [
        ("400 um", "56 um", 0.0),
        ({"shape": "annulus", "diameter": "400 um", "inner": "130 um"}, "58 um", "2 um"),
        ({"shape": "square", "diameter": "330 um"}, "76 um", "20 um"),
        (
            {"shape": "polygon", "corners": [["-200 um", "-180 um"], ["190 um", "-150 um"], ["60 um", "200 um"]]},
            "56 um",
            0.0,
        ),
    ],
    ids=["circle", "annulus", "square", "polygon"],
)
def test_of_clear_and_closed_dots_it_is_what_the_camera_tells(stop: Any, pitch: str, gutter: Any) -> None:
    camera = mf.Camera("1 mm", stop=stop, pixel="2 um", wavelengths=["530 nm", "470 nm"], window="56 um")
    panel = mf.Panel.tile(binary(7), "random", seed=3, size="540 um", pitch=pitch, gutter=gutter)
    dots = torch.from_numpy(binary(7).astype(np.float64))
    for pixels in (False, True):
        told = camera.psf(panel, "530 nm", pixels=pixels).samples
        found = mf.torch.psf(dots, camera, "530 nm", like=panel, pixels=pixels)
        assert np.abs(found.numpy() - told).max() < 1e-10 * told.max()
    told_mtf = camera.mtf(panel, "530 nm")
    found = mf.torch.mtf(dots, camera, "530 nm", like=panel)
    for name, values in (("horizontal", found[0, 146:]), ("vertical", found[:, 146])):
        assert np.abs(values.numpy() - told_mtf.cuts[name]).max() < told_mtf.uncertainty + 1e-9


def test_a_large_window_of_coarse_dots_has_sources_within_dots() -> None:
    camera = mf.Camera("1 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="24 um")
    mask = binary(5, 4)
    panel = mf.Panel.tile(mask, size="500 um", pitch="100 um")
    found = mf.torch.psf(torch.from_numpy(mask.astype(np.float64)), camera, like=panel)
    told = camera.psf(panel).samples
    assert np.abs(found.numpy() - told).max() < 1e-10 * told.max()


@pytest.mark.parametrize("cells", [(9, 9), (8, 9), (10, 8)])
def test_the_mtf_of_means_is_that_of_the_lag_table(cells: tuple[int, int]) -> None:
    turned = np.random.default_rng(3).integers(8, size=cells)
    panel = Panel(Opening("drawn", binary(7), 8000), 8000, 0, turned, Tiling.PERIODIC, None)
    table = SMALL.mtf(panel).table
    lag = 530e-3 * 1000 / 2 * 0.5 / 146 * np.arange(-146, 147)
    pixel = np.sinc(np.arange(-146, 147) / 292)
    expected = table.coarse_grid(lag, lag[146:]) * pixel * pixel[146:, None]
    dots = torch.from_numpy(binary(7).astype(np.float64))
    np.testing.assert_allclose(mf.torch.mtf(dots, SMALL, like=panel).numpy(), expected, atol=1e-12)
    told = SMALL.psf(panel).samples
    assert np.abs(mf.torch.psf(dots, SMALL, like=panel).numpy() - told).max() < 1e-10 * told.max()


def test_the_restored_error_is_that_of_a_design() -> None:
    estimate = surrogate_behind(bundled(), lattice(3, 56_000, camera=PhotoCamera.of(F1.model)))
    panel = mf.Panel.tile(binary(3), "random", seed=2, size="4.4 mm", pitch="168 um")
    error = expected_error(estimate, panel.orientations[1:-1, 1:-1], precision="float64")
    dots = grey(3, 5)
    squared = mf.torch.restored_error(dots, F1, like=panel)
    assert squared.shape == (3,)
    assert float(error(dots)) == pytest.approx(float(10 * torch.log10(squared).mean()), rel=1e-12)
    decibels = mf.torch.restored_error(dots, F1, like=panel, decibels=True)
    torch.testing.assert_close(decibels, -10 * torch.log10(squared))


def test_a_descent_reads_the_same_autocorrelation(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever changes the function of the descent changes the door's, and the other way round."""
    panel = mf.Panel.tile(binary(7), "random", seed=3, size="500 um", pitch="56 um")
    stop = tiled_stop(7, 8000, panel.orientations, SMALL.model, precision="float64")
    door = modulation(panel, SMALL.model, 530.0)
    called = []
    inner = Autocorrelation.transform

    def counted(self: Autocorrelation, unit: torch.Tensor) -> torch.Tensor:
        called.append(self)
        return inner(self, unit)

    monkeypatch.setattr(Autocorrelation, "transform", counted)
    stop.correlation(grey(7))
    door(grey(7))
    assert called == [stop.correlation, door.table]


@pytest.mark.parametrize("function", [mf.torch.psf, mf.torch.mtf])
def test_a_batch_is_its_openings_one_by_one(function: Callable[..., torch.Tensor]) -> None:
    dots = grey(7, 6, 2, 2)
    found = function(dots, SMALL, **RANDOM)
    for j in range(2):
        for i in range(2):
            torch.testing.assert_close(found[j, i], function(dots[j, i], SMALL, **RANDOM))
    both = mf.torch.restored_error(dots[0, :, :3, :3], F1, levels=(40,), **COARSE)
    torch.testing.assert_close(both[1], mf.torch.restored_error(dots[0, 1, :3, :3], F1, levels=(40,), **COARSE))


def test_single_precision_is_good_to_its_rounding() -> None:
    def gradients(dots: torch.Tensor) -> list[torch.Tensor]:
        leaf = dots.clone().requires_grad_()
        psf, mtf = mf.torch.psf(leaf, SMALL, **RANDOM), mf.torch.mtf(leaf, SMALL, **RANDOM)
        assert psf.dtype is mtf.dtype is dots.dtype
        (slope,) = torch.autograd.grad((psf**2).sum() / float(psf.detach().max()) ** 2 + mtf.mean(), leaf)
        return [psf.detach() / float(psf.detach().max()), mtf.detach(), slope / float(slope.abs().max())]

    for exact, single in zip(gradients(grey(7)), gradients(grey(7).float()), strict=True):
        assert float((single - exact).abs().max()) < 1e-5


def test_light_its_peak_and_its_area_are_those_of_the_openings() -> None:
    """Parseval; even grey; the peak, the squared field on the axis over the energy; AUC by the camera's rings."""
    wide = mf.Camera("1 mm", stop="100 um", pixel="2 um", wavelengths="530 nm", window="66 um")
    dots, panel = grey(7, 8), mf.Panel.tile(binary(7), "random", seed=1, size="500 um", pitch="56 um")
    psf = mf.torch.psf(dots, wide, like=panel)
    assert 0.85 < float(psf.sum()) * wide.psf(panel).step_um ** 2 < 1
    torch.testing.assert_close(mf.torch.psf(0.5 * dots, wide, like=panel), psf)
    clear = torch.from_numpy(binary(7).astype(np.float64))
    pupil = cut(panel_aperture(panel), SMALL.model.stop)
    peak = pupil.field_integral_um2**2 / pupil.energy_um2 / (0.530 * 1000) ** 2
    found = mf.torch.psf(clear, SMALL, like=panel)
    assert float(found[63, 63]) == pytest.approx(peak, rel=1e-9)
    rows, columns = np.mgrid[0:147, -146:147]
    ring = np.rint(np.hypot(rows, columns))
    mtf = mf.torch.mtf(clear, SMALL, like=panel).numpy()
    least = [mtf[ring == k].min() for k in range(147)]
    told = SMALL.mtf(panel)
    assert abs(np.mean(least) - told.auc.value) < told.uncertainty


@pytest.mark.parametrize("element", range(1, 8))
def test_dots_that_are_turned_turn_the_point(element: int) -> None:
    dots = grey(5, 9).numpy()
    camera, layout = SMALL, {"pitch": "40 um", "size": "480 um"}
    psf = mf.torch.psf(torch.from_numpy(dots), camera, **layout).numpy()
    turned = mf.torch.psf(torch.from_numpy(np.ascontiguousarray(orient(dots, element))), camera, **layout).numpy()
    np.testing.assert_allclose(turned, orient(psf, element), atol=1e-12 * psf.max())


@pytest.mark.parametrize(
    ("dots", "told"),
    [
        (np.ones((7, 7)), "ndarray, not a tensor"),
        (torch.ones(7, 7, dtype=torch.int64), r"torch\.int64.*dots\.double"),
        (torch.ones(7, 7, dtype=torch.bool), r"torch\.bool"),
        (torch.ones(7, 7, dtype=torch.float16), r"torch\.float16"),
        (torch.ones(7, 7, dtype=torch.complex64), r"torch\.complex64"),
        (torch.ones(7, 7, device="meta"), "device meta"),
        (torch.ones(7, 6), r"shape \(7, 6\)"),
        (torch.ones(7), r"shape \(7,\)"),
        (torch.ones(0, 7, 7), r"shape \(0, 7, 7\)"),
        (torch.full((7, 7), float("nan")), "NaN"),
        (torch.full((7, 7), 1.5), r"1\.5 to 1\.5.*sigmoid"),
        (torch.full((7, 7), -0.1), r"-0\.1 to"),
        (torch.stack([torch.ones(7, 7), torch.zeros(7, 7)]), "nothing clear"),
    ],
)
def test_dots_that_are_none_are_refused(dots: Any, told: str) -> None:
    for function in (mf.torch.psf, mf.torch.mtf, mf.torch.restored_error):
        with pytest.raises(JobError, match=rf"MF159 .*{told}"):
            function(dots, SMALL, pitch="56 um")


@pytest.mark.parametrize(
    ("stated", "told"),
    [
        ({}, "MF105 neither a pitch nor a panel"),
        ({"pitch": "56 um", "tiling": "random"}, "MF111"),
        ({"pitch": "56 um", "tiling": "spiral"}, "MF105"),
        ({"pitch": "56.5 um"}, "MF10[67]"),
        ({"pitch": "56 um", "size": "200 um"}, "MF114"),
        ({"pitch": "60 um", "gutter": "3 um"}, "MF10[67]"),
        ({"pitch": "56 um", "tiling": "hexagonal", "seed": 1}, "MF159.*hexagonal"),
        ({"pitch": "56 um", "wavelength": "40 nm"}, "MF112"),
        ({"like": mf.Panel.tile(binary(5), size="500 um", pitch="40 um")}, "MF159.*5 x 5"),
        ({"like": mf.Panel.tile(binary(7), size="500 um", pitch="56 um"), "seed": 1}, "MF105.*Leave out"),
    ],
)
def test_layouts_that_are_none_are_refused(stated: dict[str, Any], told: str) -> None:
    with pytest.raises(InputError, match=told):
        mf.torch.psf(grey(7), SMALL, **stated)


def test_a_camera_of_three_wavelengths_asks_for_one() -> None:
    with pytest.raises(JobError, match=r"MF105 no wavelength is given.*610, 530, 470"):
        mf.torch.psf(grey(7), F1, pitch="168 um")
    with pytest.raises(JobError, match="MF104 levels"):
        mf.torch.restored_error(grey(3), F1, pitch="168 um", levels=(7,))
    odd = mf.Panel.tile(binary(3), size="4.3 mm", pitch="168 um")
    with pytest.raises(JobError, match=r"MF159.*24 x 24 pixels and no gutter"):
        mf.torch.restored_error(grey(3), F1, like=odd)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU is here")
def test_on_a_gpu_it_is_what_it_is_on_the_processor() -> None:
    for function, camera, dots, layout in (
        (mf.torch.psf, SMALL, grey(7), RANDOM),
        (mf.torch.mtf, SMALL, grey(7), RANDOM),
        (mf.torch.restored_error, F1, grey(3), COARSE),
    ):
        here, there = (function(where, camera, **layout) for where in (dots, dots.cuda()))
        assert there.device.type == "cuda"
        torch.testing.assert_close(there.cpu(), here)


def test_several_wavelengths_stand_on_an_axis_as_the_camera_tells_them() -> None:
    camera = mf.Camera("5 mm", stop="400 um", pixel="2 um", window="64 um")
    panel = mf.Panel.tile(binary(7), "random", seed=1, pitch="56 um", size="560 um")
    lines = ["450 nm", 550]
    dots = torch.tensor(panel.opening).double()
    both = torch.stack([dots, dots.flip(-1)])
    found = mf.torch.psf(both, camera, lines, like=panel)
    images = camera.psf(panel, lines)
    assert found.shape == (2, 2, *images[0].samples.shape)
    for image, psf in zip(images, found[0], strict=True):
        np.testing.assert_allclose(psf, image.samples, atol=1e-10 * image.samples.max())
        np.testing.assert_array_equal(mf.torch.psf(dots, camera, [image.wavelength_nm], like=panel).shape[:1], [1])
    curves = mf.torch.mtf(dots, camera, np.array([450.0, 550.0]), like=panel)
    assert curves.shape == (2, 147, 293)
    for line, curve in zip((450, 550), curves, strict=True):
        torch.testing.assert_close(curve, mf.torch.mtf(dots, camera, line, like=panel))
