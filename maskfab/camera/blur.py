"""The blur of a real photograph: point spread functions from EXR files, and a die as it stands before the camera.

A file holds a PSF of our own writing (one line of light, samples finer than a pixel), a merged capture of a point light
(light of every pixel, also of a mosaic), or any linear picture of a point light. With the values p_n of pixels about a
centre c, the light of the background taken off,

    H(ν) = sum of p_n exp(-2πi ν (n - c)) / sum of p_n.

A die's own transfer H has y upwards, as its drawing has. A picture shows at (x, y) what the die as drawn has at
R⁻¹(x, y), so that with rows downwards H'(ν_x, ν_y) = H(R⁻¹(ν_x, -ν_y)), and H(-ν) is the conjugate of H(ν).

Notes:
    All colours share one centre, so that where they lie apart in the capture the restored picture puts them together.
    Light outside the file is not known: H lacks the halo there, and says that the light is nearer.
    A mosaic's capture tells the spread of each colour at its own pixels, which is that of cells of 2 x 2 pixels and no
    finer: interpolated, it lost 10 to 16 dB of a restored scene. So such a PSF restores cells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.base.errors import JobError, SourceError
from maskfab.base.model import Psf
from maskfab.camera.imaging import Blur, KeptBlur, Transfer
from maskfab.camera.record import of_cells
from maskfab.job.camera import Camera, Stop
from maskfab.mask.formats.exr import PREFIX, Channels, read_channels
from maskfab.optics.psf import pixel_psf

HOLDS = "fitted_psf"
"""Entry of the header by which the PSF of a fitted die is known, or of one as designed, as the entry ``made`` says."""
_CURE = "Give an EXR file of a point spread function"
_BORDER = 0.04
"""Share of a capture's side, at each edge, whose median is its background."""
_BRIGHT = 0.1
"""Of the peak: pixels whose centroid is the centre."""
_FILTER_REACH = 64
_COLOURS = 3
_MOST_CUT = 0.5
"""Share of the light that a cropped PSF keeps, at least."""


@dataclass(frozen=True, eq=False)
class MeasuredBlur(KeptBlur):
    """Blur by a point spread function of pixels.

    Attributes:
        kernels: [3, rows, columns] light of pixels, each colour's sum 1, row 0 the uppermost.
        centre: row and column of the point's image, of all colours.
        pixel_um: side of a pixel; None where no file tells.
        of_cells: whether its pixels are cells of a mosaic, 2 x 2 pixels of the sensor.
        outside: share of the light beyond its pixels, the most of any colour; None of a capture, which tells none.
    """

    kernels: Floats
    centre: tuple[float, float]
    told: tuple[str, ...]
    pixel_um: float | None = None
    of_cells: bool = False
    outside: float | None = None

    @property
    def lack(self) -> str:
        """A sentence on the light that it does not undo."""
        share = "light" if self.outside is None else f"{100 * self.outside:.2g} % of the light"
        return f"{share} beyond its pixels is not undone; with the job of its die (--job) it is, as designed"

    def within(self, rows: int, columns: int) -> tuple[MeasuredBlur, tuple[str, ...]]:
        """The blur as far as it fits a photograph, the centre kept, and a sentence on the light left out (MF351)."""
        sides = self.kernels.shape[1:]
        if sides[0] <= rows and sides[1] <= columns:
            return self, ()
        cut, centre = [], []
        for side, most, middle in zip(sides, (rows, columns), self.centre, strict=True):
            first = min(max(0, round(middle - (most - 1) / 2)), max(0, side - most))
            cut.append(slice(first, first + most))
            centre.append(middle - first)
        kernels = self.kernels[:, cut[0], cut[1]]
        kept = kernels.sum(axis=(1, 2), keepdims=True)
        if kept.min() < _MOST_CUT:
            what = (
                f"the PSF has {sides[1]} x {sides[0]} pixels, and {100 * float(kept.min()):.0f} % of its light within "
                f"the photograph's {columns} x {rows}"
            )
            raise SourceError("MF351", what, where="psf", cure="Give a larger photograph")
        said = (
            f"the PSF has {sides[1]} x {sides[0]} pixels, and the photograph {columns} x {rows}: it is cropped to "
            f"that, and {100 * max(0.0, 1 - float(kept.mean())):.2g} % of its light is left out, which is not undone"
        )
        return replace(self, kernels=kernels / kept, centre=(centre[0], centre[1])), (said,)

    def _transfer(self, shape: tuple[int, int]) -> NDArray[np.complex64]:
        sides = self.kernels.shape[1:]
        # A frame that is smaller than the kernel samples H more coarsely: the kernel repeats on itself.
        times = [-(-side // period) for side, period in zip(sides, shape, strict=True)]
        room = [count * period - side for count, period, side in zip(times, shape, sides, strict=True)]
        padded = np.pad(self.kernels, [(0, 0), (0, room[0]), (0, room[1])])
        folded = padded.reshape(_COLOURS, times[0], shape[0], times[1], shape[1]).sum(axis=(1, 3))
        y, x = np.asarray(scipy.fft.fftfreq(shape[0]))[:, None], np.asarray(scipy.fft.rfftfreq(shape[1]))
        centred = np.exp(2j * np.pi * (y * self.centre[0] + x * self.centre[1]))
        return np.asarray(scipy.fft.rfft2(folded, axes=(1, 2), workers=1) * centred, dtype=np.complex64)


def read_psf(paths: Sequence[Path]) -> MeasuredBlur:
    """The blur of one file of all colours, or of three files of one line of light each.

    Raises:
        SourceError: MF301 missing, MF303 damaged; MF352 of pixels that differ, or of samples that no pixels are made
            of; MF353 for another number of files or channels; MF334 for a file without light.
    """
    if len(paths) not in (1, _COLOURS):
        cure = "Give one file of all colours, or three of one wavelength each"
        raise SourceError("MF353", f"{len(paths)} files of point spread functions", where="psf", cure=cure)
    files = [read_channels(path, PREFIX, _CURE) for path in paths]
    for path, found in zip(paths, files, strict=True):
        _check(found, path)
    if all(channels.facts.get("kind") == "point" for channels in files):
        return _of_design(files, paths)
    if len(files) == 1 and files[0].facts.get("holds") == HOLDS:
        return _of_fit(files[0], paths[0])
    if len(files) > 1:
        cure = "Give one capture of all colours, or three files that maskfab run wrote"
        raise SourceError("MF353", "three captures of point light", where=str(paths[0]), cure=cure)
    return _of_capture(files[0], paths[0])


def read_psfs(paths: Sequence[Path], photos: int) -> tuple[MeasuredBlur, ...]:
    """The blur of each of several photographs: one of its own each where there are as many files, else one of all.

    Three files that ``maskfab run`` wrote are the colours of one. Errors as for :func:`read_psf`.
    """
    lines = len(paths) == _COLOURS and all(
        read_channels(path, PREFIX, _CURE).facts.get("kind") == "point" for path in paths
    )
    if len(paths) != photos or photos == 1 or lines:
        return (read_psf(paths),) * photos
    return tuple(read_psf([path]) for path in paths)


def _check(channels: Channels, path: Path) -> None:
    if len(channels.names) not in (1, _COLOURS) or (
        len(channels.names) == _COLOURS and set(channels.names) != set("RGB")
    ):
        what = f"{path.name} has the channels {', '.join(channels.names)}, not one, or R, G and B"
        raise SourceError("MF353", what, where=str(path), cure=_CURE)
    if channels.facts.get("holds") == "sigma":
        what = f"{path.name} holds the standard deviation of a capture"
        raise SourceError("MF353", what, where=str(path), cure="Give the file of its light")
    if not np.isfinite(channels.values).all():
        raise SourceError("MF303", f"{path.name} has values that are not finite", where=str(path), cure=_CURE)


def _of_design(files: Sequence[Channels], paths: Sequence[Path]) -> MeasuredBlur:
    """The blur of files that hold intensity at points, of light of the longest wavelength for red."""
    pixels = sorted({float(channels.facts["sensor_pixel_um"]) for channels in files})
    if len(pixels) > 1:
        what = f"the files are for pixels of {pixels[0]:g} and {pixels[-1]:g} um"
        raise SourceError("MF352", what, where=str(paths[0]), cure="Give files of one camera")
    lines = sorted(
        ((float(channels.facts["wavelength_nm"]), channels, path) for channels, path in zip(files, paths, strict=True)),
        key=lambda line: -line[0],
    )
    means = [_pixels(channels, path) for _, channels, path in lines]
    side = min(len(mean.values) for mean in means)
    surplus = [(len(mean.values) - side) // 2 for mean in means]
    kernels = np.stack([m.values[k : k + side, k : k + side] for m, k in zip(means, surplus, strict=True)])
    outside = 1 - kernels.sum(axis=(1, 2)) * pixels[0] ** 2
    colours = ", ".join(f"{nm:g}" for nm, *_ in lines)
    sentences = [f"PSF of {colours} nm as designed, {side} x {side} pixels of {pixels[0]:g} um"]
    return _made(kernels, ((side - 1) / 2, (side - 1) / 2), sentences, pixels[0], outside=outside)


def _pixels(channels: Channels, path: Path) -> Psf:
    facts: dict[str, Any] = channels.facts
    step, pixel = float(facts["step_um"]), float(facts["sensor_pixel_um"])
    stride = pixel / step
    values = channels.values[0]
    if abs(stride - round(stride)) > 1e-4 * stride or values.shape[0] != values.shape[1] or values.shape[0] % 2 == 0:
        what = (
            f"{path.name} has {values.shape[1]} x {values.shape[0]} samples {step:g} um apart, which do not make "
            f"pixels of {pixel:g} um about its middle"
        )
        raise SourceError("MF352", what, where=str(path), cure="Give a file as maskfab run writes it")
    line = float(facts["wavelength_nm"])
    window = (2 * (len(values) // 2 // round(stride)) + 1) * pixel
    camera = Camera(float(facts["focal_um"]), Stop("circle", float(facts["stop_um"])), (line,), pixel, window)
    # Beyond the window there is darkness, for the filter of the pixels at its edge.
    return pixel_psf(Psf(np.pad(values, _FILTER_REACH), pixel / round(stride), line, "point"), camera)


def _of_fit(channels: Channels, path: Path) -> MeasuredBlur:
    """The blur of a die that was fitted to a capture: the light is in the middle pixel, and nothing lies beneath it."""
    order = [channels.names.index(name) for name in "RGB"] if len(channels.names) == _COLOURS else [0]
    kernels = channels.values[order]
    outside = 1 - kernels.sum(axis=(1, 2))
    rows, columns = kernels.shape[1:]
    made = channels.facts.get("made", "as fitted to a capture")
    sentences = [f"PSF of die {channels.facts['die']} {made}, {columns} x {rows} pixels"]
    pixel_um = float(channels.facts["sensor_pixel_um"])
    return _made(kernels, ((rows - 1) / 2, (columns - 1) / 2), sentences, pixel_um, outside=outside)


def _of_capture(channels: Channels, path: Path) -> MeasuredBlur:
    mosaic = str(channels.facts.get("mosaic", "none"))
    order = [channels.names.index(name) for name in "RGB"] if len(channels.names) == _COLOURS else [0]
    planes = channels.values[order]
    sentences = [f"PSF measured, {planes.shape[2]} x {planes.shape[1]} pixels of {path.name}"]
    if mosaic == "none":
        light, ground = zip(*(_above_ground(plane, path) for plane in planes), strict=True)
        kernels = np.stack(light)
    else:
        # Every colour of each cell of 2 x 2 pixels, and the backgrounds of the four places.
        rows, columns = (side // 2 * 2 for side in planes[0].shape)
        light, ground = zip(
            *(_above_ground(planes[0][y:rows:2, x:columns:2], path) for y in (0, 1) for x in (0, 1)), strict=True
        )
        kernels = of_cells(np.stack(light), mosaic.upper())
    sentences.append(
        f"background taken off: {', '.join(f'{level:.4g}' for level in ground)}; halo as faint goes with it"
    )
    # The centre is the centroid of what is bright in all colours together.
    together = np.sum([kernel / kernel.max() for kernel in kernels], axis=0)
    bright = np.where(together >= _BRIGHT * together.max(), together, 0.0)
    y, x = np.indices(bright.shape)
    centre = float((y * bright).sum() / bright.sum()), float((x * bright).sum() / bright.sum())
    return _made(kernels, centre, sentences, of_cells=mosaic != "none")


def _above_ground(plane: Floats, path: Path) -> tuple[Floats, float]:
    ground = _border_median(plane)
    light = plane - ground
    if not light.sum() > 0:
        what = f"{path.name} holds no light above its background of {ground:.4g}"
        raise SourceError("MF334", what, where=str(path), cure="Give the capture of a point light")
    return light, ground


def _border_median(plane: Floats) -> float:
    edge = max(1, round(_BORDER * min(plane.shape)))
    inner = np.zeros(plane.shape, dtype=np.bool_)
    inner[edge:-edge, edge:-edge] = True
    return float(np.median(plane[~inner])) if not inner.all() else 0.0


def _made(
    kernels: Floats,
    centre: tuple[float, float],
    told: Sequence[str],
    pixel_um: float | None = None,
    *,
    of_cells: bool = False,
    outside: Floats | None = None,
) -> MeasuredBlur:
    whole = np.broadcast_to(kernels, (_COLOURS, *kernels.shape[1:])) if len(kernels) == 1 else kernels
    if len(kernels) == 1:
        told = [*told, "one colour is taken for all three"]
    beyond = None if outside is None else max(float(outside.max()), 0.0)
    return MeasuredBlur(whole / whole.sum(axis=(1, 2), keepdims=True), centre, tuple(told), pixel_um, of_cells, beyond)


@dataclass(frozen=True, eq=False)
class WholeBlur:
    """Blur by a measured point spread function within its window, and by a design's light beyond.

    With D the design's transfer, d its light within the window and m as much light as measured,

        H = D + sum over the window of (m - d) exp(-2πi ν r).

    A capture's background was taken off, and with it halo as faint: m has as much of it as d at the window's border.

    Attributes:
        change: m - d.

    Notes:
        Whether the design's halo is turned and scaled as the measured one changes a restored photograph by 0.01 dB:
        what counts is how much light lies how far out.
    """

    design: Blur
    change: MeasuredBlur
    told: tuple[str, ...]

    @classmethod
    def of(cls, measured: MeasuredBlur, design: Blur) -> WholeBlur:
        """A measured blur with the light of a design about it."""
        rows, columns = measured.kernels.shape[1:]
        # So far away does light begin to fold back onto the window that next to none is left.
        shape = scipy.fft.next_fast_len(2 * rows, real=True), scipy.fft.next_fast_len(2 * columns, real=True)
        y, x = np.asarray(scipy.fft.fftfreq(shape[0]))[:, None], np.asarray(scipy.fft.rfftfreq(shape[1]))
        moved = design.on(shape) * np.exp(-2j * np.pi * (y * measured.centre[0] + x * measured.centre[1]))
        spread = scipy.fft.irfft2(moved, shape, axes=(1, 2), workers=1)
        inner = np.asarray(spread[:, :rows, :columns], dtype=np.float64)
        share = inner.sum(axis=(1, 2), keepdims=True)
        faint = np.zeros((_COLOURS, 1, 1))
        if measured.outside is None:
            faint[:, 0, 0] = [max(0.0, _border_median(plane)) for plane in inner]
        light = (share - rows * columns * faint) * measured.kernels + faint
        beyond = 1 - float(share.min())
        said = f"the light beyond the window of {columns} x {rows} pixels is the design's: {100 * beyond:.2g} %"
        return cls(design, replace(measured, kernels=light - inner), (*measured.told, said))

    def on(self, shape: tuple[int, int]) -> Transfer:
        return np.asarray(self.design.on(shape) + self.change.on(shape))


STANDS: Mapping[str, int] = MappingProxyType({"drawn": 0, "turned": 1, "mirrored": 4, "mirrored-turned": 5})
"""Elements of D4, as :func:`maskfab.base.model.orient` counts, that take the die as drawn to how the picture shows it;
each stands for itself turned by 180 degrees, too."""

_WORDS = {0: "as drawn", 1: "turned by 90 degrees", 4: "mirrored", 5: "mirrored and turned by 90 degrees"}


def stand_words(way: int) -> str:
    """A stand in words, of its element of D4."""
    return _WORDS[way]


def stand_named(name: str) -> int:
    """The element of D4 of a name. Raises JobError MF105 for a name that none has."""
    if name not in STANDS:
        what = f"{name!r} is no stand of a die"
        raise JobError("MF105", what, where="stands", cure=f"Use one of {', '.join(STANDS)}; turned is by 90 degrees")
    return STANDS[name]


@dataclass(frozen=True, eq=False)
class StandingBlur:
    """Blur by a die one way round; ``drawn`` is that by the die as drawn, y upwards."""

    drawn: Blur
    way_round: int = 0

    def on(self, shape: tuple[int, int]) -> Transfer:
        rows, columns = shape
        mirrored = self.way_round >= 4
        if self.way_round % 2 == 0:
            grid_values = self.drawn.on(shape)
            return grid_values.conj() if mirrored else grid_values[:, -np.arange(rows) % rows]
        # Turned, ν_x is along the drawing's y, and ν_y along its x, of which half is kept.
        grid_values = self.drawn.on((columns, rows))
        up = np.arange(columns // 2 + 1)
        right = np.arange(rows // 2 + 1)
        left = np.arange(rows - rows // 2 - 1, 0, -1)
        here, there = (up, -up % columns) if not mirrored else (-up % columns, up)
        ahead = grid_values[:, here[:, None], right]
        behind = grid_values[:, there[:, None], left].conj()
        whole = np.concatenate([ahead, behind], axis=2).transpose(0, 2, 1)
        return np.ascontiguousarray(whole if mirrored else whole.conj())
