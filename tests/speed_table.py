"""The table of speeds that README quotes, measured here and now: ``make bench``.

Both sides of a ratio run in turn on one thread; times are medians of processor time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from importlib.util import find_spec
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from optics.published_step import WAVELENGTHS_NM, published_step
from threadpoolctl import threadpool_limits

import maskfab as mf
from maskfab.base.model import Opening, Panel, Tiling
from maskfab.designs.descent.objective import invertibility_of, tiled_stop
from maskfab.designs.descent.panel_optics import Layout
from maskfab.job.camera import Camera, Stop
from maskfab.optics.field.matrix import parity_field
from maskfab.optics.field.methods import STRUCTURE
from maskfab.optics.field.polygons import boundary
from maskfab.optics.lags import lag_table
from maskfab.optics.mtf import longest_lag_um, presampled_mtf
from maskfab.optics.psf import image_scale_um2, pixel_margin, pixel_psf, point_psf
from maskfab.optics.pupil import cut, panel_aperture
from maskfab.optics.spectrum import line_spectrum, polychromatic_otf, reach_um
from maskfab.optics.stop_edges import edges_in_stop
from maskfab.optics.tiling import orientations
from maskfab.trials.race import (
    PEERS,
    PsfTask,
    absent,
    gemm_bound_ms,
    published_intensity,
    published_size,
    race,
    slit_panel,
    standard_workload,
)

CAMERA = Camera(10_000.0, Stop("circle", 4000.0), (530.0,), 2.0, 256.0)
Row = tuple[str, str, str]


def medians(rounds: int, *functions: Callable[[], object]) -> list[float]:
    """Milliseconds of processor time of each, taken in turn; the first round does not count."""
    spent: list[list[float]] = [[] for _ in functions]
    for number in range(rounds + 1):
        for k, function in enumerate(functions):
            start = time.process_time()
            function()
            if number:
                spent[k].append(1e3 * (time.process_time() - start))
    return [float(np.median(each)) for each in spent]


def peers() -> list[Row]:
    workload = standard_workload()
    times = {(t.name, t.precision): t for t in race(workload, rounds=15)}
    bound = gemm_bound_ms(workload)
    rows = []
    for precision, cold in (("double", "3x"), ("single", "1.5x")):
        ours, theirs = times["maskfab parity", precision], times.get(("prysm matrix DFT", precision))
        if precision == "double":
            over = f"{ours.milliseconds / bound[precision]:.2f}x"
            rows.append(("PSF 512², double, warm, over the bound of its products", over, "1.3x"))
        faster = f"PSF 512², {precision}, faster than prysm's matrix DFT, "
        if theirs is None:
            rows.append((faster + "cold and warm", absent()["prysm matrix DFT"], "5x"))
            continue
        rows.append((faster + "both warm", f"{theirs.milliseconds / ours.milliseconds:.1f}x", "5x"))
        rows.append((faster + "ours cold, prysm warm", f"{theirs.milliseconds / ours.cold_milliseconds:.1f}x", cold))
        rows.append((faster + "both cold", f"{theirs.cold_milliseconds / ours.cold_milliseconds:.1f}x", cold))
    return rows


def cutting() -> list[Row]:
    """What a user calls, on a panel met for the first time, against the same of a peer from nothing."""
    aperture = panel_aperture(slit_panel(), 2000.0)
    workload = standard_workload()
    pupil = workload.pupil()
    task = PsfTask(pupil.whole, 8.0, 10_000.0, 0.53, 0.5, 512)
    spent = medians(
        9,
        lambda: cut(aperture, CAMERA.stop),
        lambda: point_psf(cut(aperture, CAMERA.stop), CAMERA, 530.0),
        *(peer.function(task) for peer in PEERS[:1] if peer.missing() is None),
        *(lambda p=peer: p.function(task)() for peer in PEERS[:1] if peer.missing() is None),
    )
    rows = [("cut of a 4 mm panel", f"{spent[0]:.1f} ms", "8 ms")]
    for name, theirs in zip(("warm", "cold"), spent[2:], strict=False):
        rows.append((f"cut and PSF, faster than prysm's {name} PSF without a rim", f"{theirs / spent[1]:.1f}x", "2x"))
    return rows


def pixels() -> Row:
    pupil = cut(panel_aperture(slit_panel(), 2000.0), CAMERA.stop)
    margin = pixel_margin(CAMERA)
    point, pixel = medians(
        9,
        lambda: point_psf(pupil, CAMERA, 530.0),
        lambda: pixel_psf(point_psf(pupil, CAMERA, 530.0, margin), CAMERA),
    )
    return "pixel-integrated PSF over the point PSF", f"{pixel / point:.2f}x", "2x"


def polychromatic() -> Row:
    pupil = cut(panel_aperture(slit_panel(), 2000.0), CAMERA.stop)
    wavelengths = np.linspace(400.0, 700.0, 31)
    spectrum = line_spectrum(wavelengths)
    nu = np.linspace(0.0, 0.25, 147)
    zero = np.zeros_like(nu)
    reach = reach_um(CAMERA, wavelengths, 0.25)

    def ours() -> None:
        table = lag_table(pupil, reach)
        for nu_x, nu_y in ((nu, zero), (zero, nu), (nu / np.sqrt(2), nu / np.sqrt(2))):
            polychromatic_otf(table, CAMERA, spectrum, nu_x, nu_y)

    sizes = [published_size(w, 10_000.0, 8.0, 0.5) for w in wavelengths[::10]]

    def published() -> None:
        for size in sizes:
            np.fft.fft2(published_intensity(pupil.whole, size, 512))

    one, other = medians(3, ours, published)
    return "polychromatic OTF, 31 lines, faster than 31 padded FFTs", f"{other * 31 / len(sizes) / one:.0f}x", "25x"


def any_lag() -> Row:
    """Three colours, the table of lags included, against the same with the shapes of cut dots left out."""
    camera = replace(CAMERA, wavelengths_nm=WAVELENGTHS_NM)
    pupil = cut(panel_aperture(slit_panel(), 2000.0), camera.stop)

    def curves(exact: bool) -> None:
        table = lag_table(pupil, longest_lag_um(camera))
        for wavelength in camera.wavelengths_nm:
            presampled_mtf(table if exact else replace(table, rims=()), camera, wavelength)

    exact, means = medians(7, lambda: curves(True), lambda: curves(False))
    return "MTF exact at any lag, three colours, over that of mean transmissions", f"{exact / means:.2f}x", "2x"


def design_step() -> list[Row]:
    """Three colours, the whole stop, invertibility loss as published; the published step has no pictures either."""
    turned = orientations(Tiling.RANDOM, 24, 24, 0)
    camera = replace(CAMERA, wavelengths_nm=WAVELENGTHS_NM)
    loss = invertibility_of(tiled_stop(21, 8000, turned, camera), own_sum=True)
    published = published_step(21, turned)
    unit = torch.rand(21, 21, generator=torch.Generator().manual_seed(0))

    def ours() -> None:
        leaf = unit.clone().requires_grad_()
        torch.autograd.grad(loss(leaf), leaf)

    one, other = medians(5, ours, lambda: published.gradient(unit))
    return [
        ("loss and gradient of a relaxed unit, three colours, single", f"{one:.0f} ms", "60 ms"),
        ("the same, faster than the published step", f"{other / one:.0f}x", "25x"),
    ]


def gradients(dots: int = 21) -> list[Row]:
    """A PSF of 511² samples of 0.5 um and the slopes of a loss of it by the dots of a unit, through the door; double.

    torchoptics has no window finer than its field's own samples, so it gets a larger image: of samples as wide as the
    dots, and a lens so many times as long. Field and window are then as few points as they can be, and its points
    become dots by one factor. It is given the rim's grey shares too.
    """
    what, limit = f"PSF 511² and its gradient by {dots}² dots, double", "40 ms" if dots == 21 else "100 ms"
    rounds = 9 if dots < 84 else 3
    panel = replace(slit_panel(dots), seed=0)
    camera = mf.Camera("10 mm", stop="4 mm", pixel="2 um", wavelengths="530 nm", window="256 um")
    unit = 0.1 + 0.8 * torch.from_numpy(panel.opening.mask.astype(np.float64))
    weight = torch.rand(511, 511, dtype=torch.float64, generator=torch.Generator().manual_seed(0))

    def taken(psf: Callable[[torch.Tensor], torch.Tensor]) -> tuple[torch.Tensor, torch.Tensor]:
        leaf = unit.clone().requires_grad_()
        image = psf(leaf)
        image = image / image.amax()
        return image.detach(), torch.autograd.grad((weight * image).sum(), leaf)[0]

    def ours(dots: torch.Tensor) -> torch.Tensor:
        return mf.torch.psf(dots, camera, like=panel)

    if find_spec("torchoptics") is None:
        (spent,) = medians(rounds, lambda: taken(ours))
        return [(what, f"{spent:.0f} ms", limit), ("the same, faster than torchoptics", "torchoptics: absent", "5x")]
    from torchoptics import Field
    from torchoptics.elements import Lens

    layout = Layout.of(panel, camera.model.stop)
    share, place = torch.from_numpy(layout.pupil.mean_transmission.copy()), torch.from_numpy(layout.place)
    side, step_um = place.shape[0], layout.pupil.x.dot_um
    focal_um = camera.model.focal_um * step_um / 0.5
    lens = Lens(side, focal_um, spacing=step_um)
    of_dot = torch.sinc(step_um * step_um * (torch.arange(511, dtype=torch.float64) - 255) / (0.53 * focal_um)) ** 2

    def theirs(dots: torch.Tensor) -> torch.Tensor:
        pupil = (dots.flatten()[place] * share).to(torch.complex128)
        seen = lens(Field(pupil, wavelength=0.53, z=0, spacing=step_um))
        image = seen.propagate((511, 511), z=focal_um, spacing=step_um, propagation_method="DIM_FRESNEL")
        return image.intensity() * of_dot[:, None] * of_dot

    (image, slope), (other, other_slope) = taken(ours), taken(theirs)
    one, peer = medians(rounds, lambda: taken(ours), lambda: taken(theirs))
    return [
        (what, f"{one:.0f} ms", limit),
        ("the same, faster than torchoptics", f"{peer / one:.1f}x", "5x"),
        ("the same, of the peak, from torchoptics' PSF", f"{float((image - other).abs().max()):.0e}", "1e-04"),
        ("the same, from torchoptics' gradient", f"{_relative(slope.numpy(), other_slope.numpy()):.0e}", "1e-03"),
    ]


def fine_dots() -> list[Row]:
    aperture = panel_aperture(slit_panel(168), 2000.0)
    pupil = cut(aperture, CAMERA.stop)
    u = (np.arange(256) + 0.5) * 0.5 / image_scale_um2(CAMERA, 530.0)
    (spent,) = medians(5, lambda: STRUCTURE.intensity(pupil, u, u))
    some = u[::32].copy()
    exact = parity_field(pupil, some, some).amplitude()
    found = STRUCTURE.amplitude(pupil, some, some)
    return [
        ("1 um dots, 4032² of them, PSF 512²", f"{spent:.0f} ms", "120 ms"),
        ("the same, error against the parity path", f"{_relative(found, exact):.0e}", "1e-08"),
    ]


def _relative(found: NDArray[Any], exact: NDArray[Any]) -> float:
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))


def polygons() -> list[Row]:
    """Scattered dots, five or six polygons to a cell."""
    mask = np.random.default_rng(1).random((21, 21)) < 0.026
    panel = Panel(Opening("dots", mask, 8000), 8000, 0, orientations(Tiling.RANDOM, 24, 24, 0), Tiling.RANDOM, 0)
    aperture = panel_aperture(panel, 2000.0)
    x, y = (np.rint(1e3 * lattice.edges_um()).astype(np.int64) for lattice in (aperture.x, aperture.y))
    rows, columns = np.nonzero(aperture.transmission)
    boxes = np.stack([x[columns], y[rows], x[columns + 1], y[rows + 1]], axis=1)
    edges, area = edges_in_stop(boxes, CAMERA.stop, (0.0, 0.0))
    step = 0.5 / image_scale_um2(CAMERA, 530.0)
    (spent,) = medians(7, lambda: boundary(edges, area, 255 * step * np.sqrt(2)).field(step, 511))
    found = abs(boundary(edges, area, 255 * step * np.sqrt(2)).field(step, 511)) ** 2
    exact = parity_field(cut(aperture, CAMERA.stop), step * np.arange(256.0), step * np.arange(256.0)).intensity()
    return [
        (f"polygon PSF 511² of {len(edges)} edges", f"{spent:.0f} ms", "60 ms"),
        ("the same, error against the parity path", f"{_relative(found, exact):.0e}", "1e-07"),
    ]


def main() -> None:
    torch.set_num_threads(1)
    with threadpool_limits(1):
        rows = [
            *peers(),
            *cutting(),
            pixels(),
            polychromatic(),
            any_lag(),
            *design_step(),
            *gradients(),
            *gradients(84),
            *fine_dots(),
            *polygons(),
        ]
    width = max(len(row[0]) for row in rows)
    for what, measured, target in rows:
        print(f"{what:{width}}  {measured:>22}  target {target}")


if __name__ == "__main__":
    main()
