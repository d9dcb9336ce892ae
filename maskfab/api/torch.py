"""PSF, MTF and restored error of an opening, differentiable in its dots, for losses of one's own.

    >>> import maskfab as mf, torch
    >>> camera = mf.Camera("1 mm", stop="400 um", pixel="2 um", wavelengths="530 nm", window="64 um")
    >>> dots = torch.rand(7, 7, dtype=torch.float64, requires_grad=True)
    >>> psf = mf.torch.psf(dots, camera, pitch="56 um", tiling="random", seed=1)
    >>> psf.shape, dots.grad is None
    (torch.Size([127, 127]), True)
    >>> psf.amax().backward()
    >>> dots.grad.shape
    torch.Size([7, 7])

``dots`` is a tensor [..., n, n] of float32 or float64, row 0 the lowest, each from 0 (chrome) to 1 (clear). Grey is an
amplitude: a dot of 0.5 passes a quarter of the light. All that comes before the last two axes is a batch. Results are
of the tensor's type and on its device, and may be differentiated twice.

The panel is stated by ``like``, a panel whose opening is replaced by the dots, or by ``pitch`` and the other arguments
of :meth:`maskfab.Panel.tile`; without a ``size`` it is as large as the camera's stop. What does not depend on the dots
is kept from call to call, for the last few layouts and cameras.

The formulas stand in :mod:`maskfab.designs.descent.panel_optics`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import numpy as np

from maskfab.api.camera import Camera
from maskfab.api.lengths import Length, Wavelength, is_one, length_text
from maskfab.api.panel import Panel
from maskfab.base import model
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.model import Tiling
from maskfab.base.units import NM_PER_UM, parse_pitch_um
from maskfab.camera.scenes import bundled
from maskfab.camera.sensor import ELECTRONS, LEVELS
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.job.camera import Camera as Lens
from maskfab.job.die import check_lens, check_pupil, check_window
from maskfab.mask.panels import CellMap, check_cover

if TYPE_CHECKING:
    import torch
    from torch import Tensor

    from maskfab.api.lengths import Wavelengths  # at run time refused here, line by line
    from maskfab.designs.descent.losses import ExpectedError
    from maskfab.designs.descent.panel_optics import Modulation, PointImage
    from maskfab.designs.model.expected_psnr import Surrogate


class LayoutKeys(TypedDict, total=False):
    """Arguments that state the panel."""

    like: model.Panel | None
    pitch: Length | None
    tiling: str | CellMap
    seed: int | None
    size: Length | None
    gutter: Length


@checked_arguments
def psf(
    dots: Tensor,
    camera: Camera,
    wavelength: Wavelength | Wavelengths | None = None,
    *,
    pixels: bool = False,
    **layout: Unpack[LayoutKeys],
) -> Tensor:
    """Point spread function, as :meth:`maskfab.Camera.psf` tells it of the same panel.

    Args:
        dots: tensor [..., n, n].
        camera: that looks through the panel.
        wavelength: one of the camera's or any other, or several; may be left out if the camera has only one.
        like: panel whose dots, gutters and orientations are taken.
        pitch: of a pixel, gutter included, where there is no ``like``.
        tiling: how pixels are turned, or a map, as :meth:`maskfab.Panel.tile` takes it; so the next three.
        seed: of a random tiling.
        size: side of the square that is filled; :func:`restored_error` asks for an even number of pixels along it, so
            leave it out, or take twice a number of pitches.
        gutter: opaque space round every pixel.
        pixels: means over sensor pixels instead of intensity at points.

    Returns:
        Tensor [..., samples, samples], of several wavelengths [..., wavelengths, samples, samples], per square
        micrometre of sensor, whose whole plane holds 1; the axis is in the middle, rows go up. It is that of
        :meth:`maskfab.Camera.psf` within 1e-10 of the peak in float64, 1e-6 in float32.

    Raises:
        JobError: MF159 for dots that are no such tensor, or a panel that has more than one opening, wires or hexagonal
            cells; MF105 for a layout that is not stated, or stated twice; MF103 to MF108, MF111, MF115, MF122 for the
            layout; MF105 for no wavelength of several, MF103 to MF105 and MF112 for what is none; MF113 for a window
            that is too wide, MF114 for a panel smaller than the stop; MF152 without torch.
    """
    laid = _layout(dots, camera, **layout)
    lines = camera.asked_nm(wavelength)
    # Samples lie as close as those of the camera's own wavelengths.
    lens = replace(camera.model, wavelengths_nm=tuple(dict.fromkeys((*lines, *camera.model.wavelengths_nm))))
    return _of_lines(wavelength, [_image(laid, lens, line, pixels, dots.dtype, dots.device)(dots) for line in lines])


@checked_arguments
def mtf(
    dots: Tensor, camera: Camera, wavelength: Wavelength | Wavelengths | None = None, **layout: Unpack[LayoutKeys]
) -> Tensor:
    """Presampled modulation transfer function, optics and sensor pixel, as :meth:`maskfab.Camera.mtf` has it.

    Arguments and errors are those of :func:`psf`, but for the window, which it does not use.

    Returns:
        Tensor [..., 147, 293], of several wavelengths [..., wavelengths, 147, 293]: rows at vertical frequencies from 0
        to half a cycle per pixel, columns at horizontal ones from minus to plus that; opposite frequencies are alike.
        Steps are those of
        ``camera.mtf(panel).frequency_cy_per_mm``, so that ``mtf[0, 146:]`` is the cut ``"horizontal"`` and
        ``mtf[:, 146]`` the cut ``"vertical"``. Dots that the stop cuts count with their mean transmission. That is
        within the uncertainty of :meth:`maskfab.Camera.mtf`: 1e-4 for 8 um dots behind a stop of 4 mm, where the cuts
        differ by 7e-5.
    """
    laid = _layout(dots, camera, **layout)
    lenses = [replace(camera.model, wavelengths_nm=(line,)) for line in camera.asked_nm(wavelength)]
    found = [_modulation(laid, lens, *lens.wavelengths_nm, dots.dtype, dots.device)(dots) for lens in lenses]
    return _of_lines(wavelength, found)


@checked_arguments
def restored_error(
    dots: Tensor,
    camera: Camera,
    *,
    levels: Sequence[int] = LEVELS,
    decibels: bool = False,
    **layout: Unpack[LayoutKeys],
) -> Tensor:
    """Error that restored photographs are expected to keep, of this very layout, by the loss of :func:`maskfab.design`.

    It is the objective ``expected_error``: noise, what a Wiener filter holds back, and halo across the sensor's edge,
    each level with its best constant, by synthetic scenes, at the camera's middle wavelength. As in a design the dots
    whose middles lie in the stop count, whole. A batch is gone through one by one.

    Arguments and errors are those of :func:`psf`, and these:

    Args:
        levels: of light in dB, among 24, 32 and 40.
        decibels: the expected PSNR instead.

    Returns:
        Tensor [..., levels]: mean squared error, white is 1; or PSNR in dB.

    Raises:
        JobError: MF104 for a level that is not known; MF133 to MF135 for a camera that no design knows; MF159 for
            a panel with gutters, or whose number of pixels along a side is odd.
    """
    chosen = tuple(levels)
    if not chosen or any(level not in ELECTRONS for level in chosen):
        cure = f"Choose among {', '.join(map(str, ELECTRONS))}"
        raise JobError("MF104", f"levels = {list(levels)} are not known levels", where=_where("levels"), cure=cure)
    laid = _layout(dots, camera, **layout)
    lens = PhotoCamera.of(camera.model, where="Camera")
    error, estimate = _expected(laid, lens, chosen, str(dots.dtype).removeprefix("torch."), dots.device.type)
    units = dots.reshape(-1, *dots.shape[-2:]).unbind()
    import torch

    found = torch.stack([error.errors(error.correlation(unit)) for unit in units]).view(*dots.shape[:-2], len(chosen))
    if not decibels:
        return found
    added = torch.tensor([estimate.noise.added_db(level) for level in chosen], dtype=dots.dtype, device=dots.device)
    return -10 * torch.log10(found) + added


def _of_lines(wavelength: object, found: list[Tensor]) -> Tensor:
    """The tensor of one wavelength as it is, those of several on an axis of their own."""
    import torch

    return found[0] if wavelength is None or is_one(wavelength) else torch.stack(found, -3)


def _where(argument: str) -> str:
    return f"maskfab.torch: {argument}"


def _refused(what: str, cure: str, argument: str = "dots") -> JobError:
    return JobError("MF159", what, where=_where(argument), cure=cure)


# Rounding of a sum of binary and relaxed dots may leave a value this much outside.
_SLACK = 1e-5
_DEVICES = ("cpu", "cuda")


def _require_dots(dots: Any) -> None:
    """Refuse what is no tensor of dots."""
    require("design", what="a gradient", where="maskfab.torch")
    import torch

    if not isinstance(dots, torch.Tensor):
        cure = "Give torch.tensor(array).double()"
        raise _refused(f"dots are of the type {type(dots).__name__}, not a tensor", cure)
    if dots.dtype not in (torch.float32, torch.float64):
        raise _refused(f"dots are of {dots.dtype}; gradients need float32 or float64", "Give dots.double()")
    if dots.device.type not in _DEVICES:
        raise _refused(f"dots are on the device {dots.device}", "Give dots.cpu(), or dots on cuda")
    shape = tuple(dots.shape)
    if len(shape) < 2 or shape[-1] != shape[-2] or not dots.numel():
        raise _refused(f"dots of the shape {shape} are no square openings [..., n, n]", "Give as many rows as columns")
    held = dots.detach()
    low, high = float(held.min()), float(held.max())
    if math.isnan(low):
        raise _refused("some dots are NaN", "Stop at the step that gave them, and take a smaller one")
    if low < -_SLACK or high > 1 + _SLACK:
        cure = "Give torch.sigmoid(logits), or dots.clamp(0, 1)"
        raise _refused(f"dots are {low:g} to {high:g}; chrome is 0 and clear is 1", cure)
    if not bool((held.amax((-2, -1)) > 0).all()):
        raise _refused("an opening has nothing clear, so that no light forms an image", "Open some of its dots")


class _Layout:
    """A panel with all its dots clear, equal to another one of the same dots, gutters and orientations."""

    def __init__(self, panel: model.Panel) -> None:
        dots = panel.opening.dots
        opening = model.Opening("dots", np.ones((dots, dots), dtype=np.bool_), panel.dot_nm)
        self.panel = model.Panel(opening, panel.dot_nm, panel.gutter_nm, panel.orientations, panel.tiling, panel.seed)
        turned = panel.orientations
        self._key = dots, panel.dot_nm, panel.gutter_nm, turned.shape, turned.tobytes()

    def __hash__(self) -> int:
        return hash(self._key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Layout) and self._key == other._key


def _layout(
    dots: Any,
    camera: Camera,
    like: model.Panel | None = None,
    pitch: Length | None = None,
    tiling: str | CellMap = Tiling.PERIODIC,
    seed: int | None = None,
    size: Length | None = None,
    gutter: Length = 0.0,
) -> _Layout:
    _require_dots(dots)
    count = int(dots.shape[-1])
    if like is not None:
        stated = (pitch, seed, size) != (None, None, None) or tiling != Tiling.PERIODIC or gutter != 0.0
        if stated:
            what = "a panel to be like states its layout, and so do other arguments"
            raise JobError("MF105", what, where=_where("like"), cure="Leave out pitch, tiling, seed, size and gutter")
        panel = like
    elif pitch is None:
        what = "neither a pitch nor a panel to be like is given"
        raise JobError("MF105", what, where=_where("pitch"), cure='Add pitch = "168 um", or like = panel')
    else:
        if size is None and not isinstance(tiling, CellMap):
            pitch_um = parse_pitch_um(length_text(pitch, "pitch", _where("pitch")), where=_where("pitch"))
            size = 2 * math.ceil(camera.model.stop.diameter_um / (2 * pitch_um) - 1e-9) * pitch_um
        clear = np.ones((count, count), dtype=np.bool_)
        panel = Panel.tile(clear, tiling, seed=seed, size=size, pitch=pitch, gutter=gutter)
    if panel.others or panel.tracks or panel.tiling is Tiling.HEXAGONAL:
        what = "the panel has more than one opening, wires, or hexagonal cells"
        raise _refused(what, "Take a panel of one opening on square cells, without wires", "like")
    if panel.opening.dots != count:
        own = panel.opening.dots
        what = f"dots are {count} x {count}, and the panel's opening {own} x {own}"
        raise _refused(what, f"Give {own} x {own} dots, or another panel", "like")
    return _Layout(panel)


@lru_cache(maxsize=8)
def _image(
    layout: _Layout, lens: Lens, line: float, pixels: bool, dtype: torch.dtype, device: torch.device
) -> PointImage:
    from maskfab.designs.descent.panel_optics import point_image

    _check(layout, lens)
    dot_um = layout.panel.dot_nm / NM_PER_UM
    check_window(replace(lens, wavelengths_nm=(line,)), dot_um, where="Camera")
    return point_image(layout.panel, lens, line, pixels=pixels, dtype=dtype, device=device)


@lru_cache(maxsize=8)
def _modulation(layout: _Layout, lens: Lens, line: float, dtype: torch.dtype, device: torch.device) -> Modulation:
    from maskfab.designs.descent.panel_optics import modulation

    _check(layout, lens)
    return modulation(layout.panel, lens, line, dtype=dtype, device=device)


def _check(layout: _Layout, lens: Lens) -> None:
    check_lens(lens, where="Camera: stop")
    check_pupil(lens, layout.panel.dot_nm / NM_PER_UM, where="Camera")
    check_cover(layout.panel, lens.stop, "the panel", where="Camera: stop")


@lru_cache(maxsize=4)
def _expected(
    layout: _Layout, camera: PhotoCamera, levels: tuple[int, ...], precision: Any, device: str
) -> tuple[ExpectedError, Surrogate]:
    """The expected error as a function of the dots, and the scenes behind it; the last few are kept."""
    from maskfab.designs.descent.losses import expected_error
    from maskfab.designs.model.expected_psnr import surrogate_behind

    panel = layout.panel
    room = lattice(panel.opening.dots, panel.dot_nm, camera=camera, where=_where("dots"))
    rows, columns = panel.orientations.shape
    spare = rows - room.cells
    if panel.gutter_nm or rows != columns or spare % 2 or spare < 0:
        gutter_um = panel.gutter_nm / NM_PER_UM
        what = f"the panel has {columns} x {rows} pixels and gutters of {gutter_um:g} um; photographs are expected "
        what += f"behind an even number of pixels from {room.cells} on, without gutters"
        raise _refused(what, f"Give {room.cells} x {room.cells} pixels and no gutter", "like")
    middle = slice(spare // 2, spare // 2 + room.cells)
    turned = np.ascontiguousarray(panel.orientations[middle, middle])
    estimate = surrogate_behind(bundled(), room)
    return expected_error(estimate, turned, levels=levels, precision=precision, device=device), estimate
