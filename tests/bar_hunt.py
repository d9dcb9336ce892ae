"""A hunt over drawn scenes for an error bar that is below the truth: ``python tests/bar_hunt.py --scenes 2000``.

Every scene is a panel, a camera and what the report states of them; the truth comes from ``brute_optics``, which shares
no optics with the package. For each number the table has the scenes in which it was checked, how often the truth was
outside the bar, and the median and the largest of stated over true error. A true error below the stated floor of
rounding counts as that floor.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from brute_optics import Boxes, Outline, Picture, Slices, boxes_of

from maskfab.base.errors import JobError
from maskfab.base.model import Die, DieOptics, Opening, Panel, Psf, Quantity, Tiling
from maskfab.findings.optics import measure
from maskfab.findings.scene import measure_scene
from maskfab.job.camera import Camera, Stop
from maskfab.job.process import UNSTATED, MaskBlank
from maskfab.optics.pupil import panel_aperture
from maskfab.optics.scene.plan import plan as plan_scene
from maskfab.optics.scene.point_images import scene_psf, spectrum_psf
from maskfab.optics.scene.scene import Scene
from maskfab.optics.spectrum import Band, Curve
from maskfab.optics.tiling import orientations

FLOOR = 1e-8
"""Of the size of a number: true errors below it are rounding."""

SHAPES = ("circle", "circle", "circle", "square", "rectangle", "ellipse", "annulus", "polygon")
TILINGS = (
    Tiling.PERIODIC,
    Tiling.RANDOM,
    Tiling.PAPER4,
    Tiling.FLIPS,
    Tiling.ROT90,
    Tiling.ROT90FLIP,
    Tiling.BLUE_NOISE,
)
_TINY_UM = 140.0
_DIRECTIONS = 128
_BAND_LINES = 61


@dataclass(frozen=True)
class Finding:
    """One stated number and the truth.

    Attributes:
        bar: its stated error.
        error: how far it is from the truth.
        doubt: bound of the truth's own error.
        size: of the number, of which rounding is a share.
    """

    scene: int
    name: str
    bar: float
    error: float
    doubt: float
    size: float

    @property
    def below(self) -> bool:
        return self.error > self.bar + self.doubt + 1e-13 * self.size

    @property
    def ratio(self) -> float:
        rounding = FLOOR * self.size or 1.0
        return (self.bar + rounding) / (max(self.error, self.doubt) + rounding)


@dataclass(frozen=True, eq=False)
class Drawn:
    """A scene: panel, camera and blank, and its pupil in slices."""

    number: int
    panel: Panel
    camera: Camera
    blank: MaskBlank = UNSTATED

    @classmethod
    def of(cls, seed: int, number: int) -> Drawn:
        """The scene of a number; some are as large as a phone's lens."""
        draw = np.random.default_rng([seed, number])
        large = draw.random() < 0.03
        diameter = float(np.round(draw.uniform(1500, 3000) if large else 100 * 6 ** draw.random() ** 1.3, 2))
        shape = "circle" if large else str(draw.choice(SHAPES))
        dot_nm = int(draw.integers(4000, 11001)) // 2 * 2
        if large:
            dot_nm = 2 * dot_nm
        dots = int(draw.integers(3, 22))
        gutter_nm = 2 * int(draw.integers(0, dot_nm)) if draw.random() < 0.4 else 0
        mask = draw.random((dots, dots)) < draw.uniform(0.05, 0.95)
        if draw.random() < 0.3:
            mask[:] = False
            low, high = np.sort(draw.integers(0, dots + 1, (2, 2)), axis=1).T[:2]
            mask[low[0] : high[0] + 1, low[1] : high[1] + 1] = True
        mask[dots // 2, dots // 2] = True
        stop = _stop(shape, diameter, draw)
        pitch_um = 1e-3 * (dots * dot_nm + gutter_nm)
        cells = 2 * math.ceil(stop.diameter_um / 2 / pitch_um)
        tiling = TILINGS[draw.integers(len(TILINGS))]
        drawn_by = int(draw.integers(1000)) if tiling.seeded else None
        panel = Panel(
            Opening("HUNTED", mask, dot_nm, "drawn"), dot_nm, gutter_nm,
            orientations(tiling, cells, cells, drawn_by), tiling, drawn_by,
        )  # fmt: skip
        focal = 6000.0 if large else float(np.round(draw.uniform(1500, 6000)))
        count = 1 if large else int(draw.choice([1, 1, 1, 1, 2, 3]))
        lines = tuple(float(line) for line in np.round(draw.uniform(400, 900, count), 1))
        pixel = 1.4 if large else float(np.round(draw.uniform(0.8, 3.0), 2))
        window = min(float(np.round(draw.uniform(30, 70))), 0.9e-3 * min(lines) * focal / (1e-3 * dot_nm))
        blank = UNSTATED
        if draw.random() < 0.1 and not large:
            blank = MaskBlank(float(np.round(draw.uniform(1.5, 4), 2)), float(np.round(draw.uniform(-0.5, 0.5), 2)))
        drawn = cls(number, panel, Camera(focal, stop, tuple(dict.fromkeys(lines)), pixel, window), blank)
        if drawn.slices.area_um2() > 1e-3 * stop.area_um2:
            return drawn
        lit = replace(panel.opening, mask=np.ones_like(mask))  # else the stop may see nothing clear at all
        return replace(drawn, panel=replace(panel, opening=lit))

    @property
    def leak(self) -> complex:
        density, phase = self.blank.optical_density, self.blank.film_phase_waves
        if density is None or phase is None:
            return 0.0
        return complex(10 ** (-density / 2) * np.exp(2j * np.pi * phase))

    @cached_property
    def slices(self) -> Slices:
        panel, stop = self.panel, self.camera.stop
        boxes = boxes_of(panel.orientations, panel.pattern, 1e-3 * panel.dot_nm, 1e-3 * panel.gutter_nm)
        outline = Outline.of(stop.shape, *stop.sides_um, stop.inner_share, stop.outline_um)
        return Slices(boxes, outline, self.leak, 24)

    @property
    def tiny(self) -> bool:
        """Whether lags by the thousand cost little."""
        return self.camera.stop.diameter_um <= _TINY_UM

    def shapes(self) -> np.ndarray:
        """Clear dots as boxes in nanometres about the axis."""
        boxes = self.slices.boxes
        row, column = np.nonzero(boxes.clear)
        x, y = (np.rint(1e3 * lines).astype(np.int64) for lines in (boxes.x_um, boxes.y_um))
        return np.stack([x[column], y[row], x[column + 1], y[row + 1]], axis=1)

    def stated(self) -> DieOptics:
        die = Die("HUNTED", "HUNTED", self.panel, (0, 0), max(self.panel.size_nm))
        x0, y0, x1, y1 = die.box_nm
        moved = np.array([(x0 + x1) // 2, (y0 + y1) // 2] * 2)
        return measure(die, self.camera, self.shapes() + moved, self.blank)

    def scale_um2(self, line_nm: float) -> float:
        return 1e-3 * line_nm * self.camera.focal_um

    def picture(self, line_nm: float, half_um: float) -> Picture:
        """The PSF over a square window."""
        scale = self.scale_um2(line_nm)
        places, _ = Picture.nodes(half_um, self.camera.stop.diameter_um / scale)
        places = half_um * places / scale
        amplitude = self.slices.field(places, places)
        return Picture.of(half_um, (amplitude.real**2 + amplitude.imag**2) / (scale**2 * self.slices.energy_um2()))

    def modulation(self, line_nm: float, nu_x: np.ndarray, nu_y: np.ndarray) -> np.ndarray:
        """The presampled MTF at frequencies [n], cycles per micrometre."""
        scale, pixel = self.scale_um2(line_nm), self.camera.pixel_um
        own = self.slices.overlaps(scale * nu_x, scale * nu_y) / self._unmoved
        return np.asarray(abs(own * np.sinc(nu_x * pixel) * np.sinc(nu_y * pixel)))

    @cached_property
    def _unmoved(self) -> float:
        return self.slices.area_um2()


def _stop(shape: str, diameter: float, draw: np.random.Generator) -> Stop:
    other = float(np.round(diameter * draw.uniform(0.4, 1), 2))
    if shape == "rectangle":
        return Stop.rectangle(diameter, other)
    if shape == "ellipse":
        return Stop.ellipse(*((diameter, other) if draw.random() < 0.5 else (other, diameter)))
    if shape == "annulus":
        return Stop.annulus(diameter, float(np.round(diameter * draw.uniform(0.1, 0.7), 2)))
    if shape == "polygon":
        count = int(draw.integers(3, 9))
        angle = 2 * np.pi * (np.arange(count) + draw.random()) / count
        return Stop.polygon([(round(diameter / 2 * np.cos(a), 2), round(diameter / 2 * np.sin(a), 2)) for a in angle])
    return Stop(shape, diameter)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class Judge:
    """Stated numbers of one scene against the truth."""

    drawn: Drawn
    quantities: tuple[Quantity, ...]
    draw: np.random.Generator
    found: list[Finding] = field(default_factory=list)

    def tell(
        self, name: str, value: float, bar: float | None, truth: float, doubt: float = 0.0, size: float = 0.0
    ) -> None:
        size = size or max(abs(value), abs(truth))
        self.found.append(Finding(self.drawn.number, name, bar or 0.0, abs(value - truth), doubt, size))

    def of(self, name: str, line: float | None = None) -> Quantity | None:
        for quantity in self.quantities:
            if quantity.name == name and (line is None or quantity.wavelength_nm == line):
                return quantity
        return None

    def check(self, name: str, truth: float, line: float | None = None, doubt: float = 0.0, size: float = 0.0) -> None:
        quantity = self.of(name, line)
        if quantity is not None and isinstance(quantity.value, int | float):
            self.tell(name, float(quantity.value), quantity.uncertainty, truth, doubt, size)


def areas(judge: Judge) -> None:
    """Open ratios, Strehl ratios and orders."""
    drawn, panel = judge.drawn, judge.drawn.panel
    stop = Slices(Boxes(*2 * (np.array([-1e4, 1e4]),), np.ones((1, 1), dtype=bool)), drawn.slices.outline).area_um2()
    clear, tau = drawn.slices.area_um2(), drawn.leak
    judge.check("stop_open_ratio", clear / stop)
    pitch_nm = panel.opening.dots * panel.dot_nm + panel.gutter_nm
    judge.check("open_ratio", float(panel.opening.mask.sum()) * panel.dot_nm**2 / pitch_nm**2)
    amplitude = abs(clear + tau * (stop - clear)) / stop
    energy = drawn.slices.energy_um2() / stop
    for line in drawn.camera.wavelengths_nm:
        judge.check("peak_strehl", amplitude**2, line)
        judge.check("energy_normalised_strehl", amplitude**2 / energy, line)
        judge.check("strehl_invariant_error", 0.0, line, size=1.0)
        judge.check("readback_psf_difference", 0.0, line, size=1.0)
    judge.check("mtf_volume_invariant_error", 0.0, size=1.0)
    zero = judge.of("order_zero_incident")
    if zero is not None:
        dot, count = 1e-3 * panel.dot_nm, panel.opening.dots
        pitch = dot * count + 1e-3 * panel.gutter_nm
        centres = dot * (np.arange(count) - (count - 1) / 2)
        waves = {m: dot * np.sinc(m * dot / pitch) * np.exp(-2j * np.pi * m / pitch * centres) for m in (-1, 0, 1)}
        cell = panel.pattern(int(panel.orientations[0, 0])).astype(float)
        share = {
            (m, n): abs(waves[n] @ cell @ waves[m]) ** 2 / pitch**4
            for m, n in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))
        }
        for light, whole in (("incident", 1.0), ("transmitted", cell.sum() * dot**2 / pitch**2)):
            judge.check(f"order_zero_{light}", share[0, 0] / whole)
            judge.check(f"orders_lowest_five_{light}", sum(share.values()) / whole)


def pictures(judge: Judge, psfs: Iterable[Psf]) -> None:
    """Everything that is told of a PSF."""
    drawn, camera = judge.drawn, judge.drawn.camera
    made: list[tuple[Psf, Psf]] = []
    lines, middle = camera.wavelengths_nm, sorted(camera.wavelengths_nm)[len(camera.wavelengths_nm) // 2]
    for line, points, pixels in zip(lines, *_by_kind(psfs), strict=True):
        if line != middle and len(lines) < 3:
            continue
        half = max(pixels.step_um * pixels.values.shape[0], points.step_um * points.values.shape[0]) / 2
        half += drawn.scale_um2(line) / camera.stop.diameter_um / 4
        made.append((points, pixels))
        if line != middle:
            continue
        picture = drawn.picture(line, half)
        side = pixels.step_um * pixels.values.shape[0]
        judge.check("psf_energy_in_window", picture.in_square(side), line)
        core = judge.of("ensquared_energy", line)
        if core is not None and core.detail:
            judge.check("ensquared_energy", picture.in_square(float(core.detail.split()[0])), line)
        halo = judge.of("halo_energy", line)
        if halo is not None and halo.detail:
            judge.check("halo_energy", 1 - picture.in_circle(float(halo.detail.split()[0])), line)
        reach = pixels.values.shape[0] // 2
        truth = picture.pixel_means(pixels.step_um, reach)
        judge.tell(
            "pixels of the PSF", 0.0, 1e-8 * truth.max(), float(abs(pixels.values - truth).max()), size=truth.max()
        )
        _lobes(judge, points, picture, line)
        _streaks(judge, points, picture, line)
    if len(made) == 3:
        _colours(judge, made)


def _by_kind(psfs: Iterable[Psf]) -> tuple[list[Psf], list[Psf]]:
    told = list(psfs)
    return [psf for psf in told if psf.kind == "point"], [psf for psf in told if psf.kind == "pixel"]


def _lobes(judge: Judge, points: Psf, picture: Picture, line: float) -> None:
    """The brightest and the nearest other maximum, climbed on a grid eight times as fine as the samples."""
    drawn = judge.drawn
    half = points.step_um * (points.values.shape[0] // 2)
    step = drawn.scale_um2(line) / drawn.camera.stop.diameter_um / 24
    contrast = judge.of("peak_to_side_lobe", line)
    nearest = judge.of("first_side_lobe", line)
    if contrast is None and nearest is None:
        return
    lobes = np.array([picture.climbed(x, y, step) for x, y, _ in picture.lobes(half + step, step).tolist()])
    if len(lobes):
        inside = (abs(lobes[:, :2]) <= half).all(axis=1)
        lobes = lobes[inside & (np.hypot(lobes[:, 0], lobes[:, 1]) > step / 2)]
    peak = float(picture.at(np.zeros(1), np.zeros(1))[0])
    if contrast is not None and isinstance(contrast.value, float) and len(lobes):
        highest = float(lobes[:, 2].max())
        judge.check(
            "peak_to_side_lobe", peak / highest, line, doubt=(peak / highest) ** 2 * (10 * picture.error + 1e-13)
        )
    if nearest is not None and isinstance(nearest.value, float) and len(lobes):
        distance = float(np.hypot(lobes[:, 0], lobes[:, 1]).min())
        judge.check("first_side_lobe", distance, line, doubt=1e-5 * step)


def _streaks(judge: Judge, points: Psf, picture: Picture, line: float) -> None:
    """Moments of the angle over the annulus, and their largest sum."""
    told = judge.of("streak_index", line)
    if told is None or not isinstance(told.value, float):
        return
    outer = min(50.0, points.step_um * (points.values.shape[0] // 2))
    inner = min(10.0, outer / 2)
    count = len(picture.series) + 16
    nodes, weights = np.polynomial.legendre.leggauss(count)
    radius = inner + (outer - inner) * (1 + nodes) / 2
    angle = 2 * np.pi * np.arange(3 * count) / (3 * count)
    values = picture.at(np.outer(radius, np.cos(angle)), np.outer(radius, np.sin(angle)))
    tail = (weights * radius * np.sin(np.pi * (radius - inner) / (outer - inner)) ** 2) @ values
    order = np.arange(1, 19)
    moments = (tail * np.exp(-2j * order[:, None] * angle)).sum(axis=1) / tail.sum() * (1 - order / 19)
    seen = np.linspace(0, 2 * np.pi, 20000)
    judge.check("streak_index", float(1 + 2 * (moments @ np.exp(1j * order[:, None] * seen)).real.max()), line)


def _colours(judge: Judge, made: list[tuple[Psf, Psf]]) -> None:
    """The distance of red and blue, from a window three times as wide and what is still outside it."""
    told = judge.of("colour_distance")
    if told is None or not isinstance(told.value, float) or not judge.drawn.tiny:
        return
    ordered = sorted(made, key=lambda item: item[0].wavelength_nm)
    reach = 3 * (ordered[0][1].values.shape[0] // 2)
    pixel = ordered[0][1].step_um
    wide = [judge.drawn.picture(item[0].wavelength_nm, (reach + 0.5) * pixel) for item in (ordered[0], ordered[-1])]
    blue, red = (picture.pixel_means(pixel, reach) * pixel**2 for picture in wide)
    outside = [1 - float(blue.sum()), 1 - float(red.sum())]
    within = 0.5 * float(abs(blue - red).sum())
    judge.check("colour_distance", within + max(outside) / 2, doubt=min(outside) / 2)


def transfers(judge: Judge, optics: DieOptics, *, quick: bool) -> None:
    """Cuts, rings and falls of the MTF, its aliases, and what a Wiener filter makes of it; openings alone."""
    drawn, camera = judge.drawn, judge.drawn.camera
    if drawn.leak:
        return
    costly = camera.stop.diameter_um > 700
    for mtf in optics.mtfs[:1]:
        line, nu = mtf.wavelength_nm, 1e-3 * mtf.frequency_cy_per_mm
        some = judge.draw.integers(1, nu.size, 2 if costly else 6)
        turn = {
            "horizontal": (1, 0),
            "vertical": (0, 1),
            "diagonal": (math.sqrt(0.5),) * 2,
            "antidiagonal": (-math.sqrt(0.5), math.sqrt(0.5)),
        }
        for cut, (x, y) in turn.items():
            truth = drawn.modulation(line, x * nu[some], y * nu[some])
            worst = int(np.argmax(abs(mtf.cuts[cut][some] - truth)))
            judge.tell(
                "cut of the MTF",
                float(mtf.cuts[cut][some][worst]),
                mtf.uncertainty,
                float(truth[worst]),
                2e-10,
                size=1.0,
            )
        if costly or quick:
            continue
        if judge.draw.random() < (0.3 if drawn.tiny else 0.02):
            _falls(judge, line)
        if drawn.tiny:
            if judge.draw.random() < 0.3:
                _aliases(judge, line, nu)
            if judge.draw.random() < 0.12:
                _rings(judge, mtf, nu)
                _wiener(judge, line)


def _falls(judge: Judge, line: float) -> None:
    drawn = judge.drawn
    angle = np.pi * (np.arange(_DIRECTIONS) + 0.5) / _DIRECTIONS

    def mean(radius: float) -> tuple[float, float]:
        values = drawn.modulation(line, radius * np.cos(angle), radius * np.sin(angle))
        return float(values.mean()), abs(float(values[::2].mean() - values[1::2].mean())) / 2

    for level in (50, 30, 10):
        told = judge.of(f"mtf{level}", line)
        if told is None or not isinstance(told.value, float) or not told.value:
            continue
        radius, before = 1e-3 * told.value, 1e-3 * told.value * (1 + 1e-4)
        value, doubt = mean(radius)
        last, _ = mean(before)
        for _ in range(4):
            if value == last or abs(value - level / 100) < 1e-9:
                break
            radius, before, last = radius - (value - level / 100) * (radius - before) / (value - last), radius, value
            if not 0.5e-3 * told.value < radius < 2e-3 * told.value:
                break
            value, doubt = mean(radius)
        else:
            slope = abs((value - last) / (radius - before)) if radius != before else math.inf
            judge.check(f"mtf{level}", 1e3 * radius, line, doubt=1e3 * doubt / slope)


def _aliases(judge: Judge, line: float, nu: np.ndarray) -> None:
    drawn, pixel = judge.drawn, judge.drawn.camera.pixel_um
    highest = drawn.camera.stop.diameter_um / drawn.scale_um2(line)
    last = math.ceil((highest + nu[-1]) * pixel)
    orders = np.arange(-last, last + 1)
    alias = nu + orders[:, None] / pixel
    turn = np.exp(2j * np.pi * np.arange(16)[:, None] / 16 * orders)
    farthest, change = [], []
    for along in ((1, 0), (0, 1)):
        lags = drawn.scale_um2(line) * alias.ravel()
        values = np.zeros(lags.size)
        near = abs(alias.ravel()) < highest
        values[near] = drawn.slices.overlaps(along[0] * lags[near], along[1] * lags[near]) / drawn._unmoved
        values = values.reshape(alias.shape) * np.sinc(alias * pixel)
        sampled = abs(turn @ values)
        farthest.append(abs(sampled - abs(values[last])).max())
        change.append((sampled.max(axis=0) - sampled.min(axis=0)).max())
    judge.check("mtf_aliasing", float(max(farthest)), line, size=1.0)
    judge.check("mtf_phase_range", float(max(change)), line, size=1.0)


def _rings(judge: Judge, mtf: Any, nu: np.ndarray) -> None:
    """The mean of the rings' least values, all of them."""
    count, step = nu.size, nu[1]
    axis = np.arange(count)
    across, up = np.meshgrid(np.concatenate([-axis[:0:-1], axis]), axis)
    ring = np.rint(np.hypot(across, up)).astype(int)
    inside = (ring < count) & ((up > 0) | (across >= 0))
    values = judge.drawn.modulation(mtf.wavelength_nm, step * across[inside], step * up[inside])
    least = np.full(count, np.inf)
    np.minimum.at(least, ring[inside], values)
    judge.check("auc_radial_min", float(least.mean()), mtf.wavelength_nm, size=1.0)
    mean = np.bincount(ring[inside], values) / np.bincount(ring[inside])
    judge.tell(
        "ring's mean of the MTF", 0.0, mtf.uncertainty, float(abs(mean - mtf.cuts["radial_mean"]).max()), size=1.0
    )


def _wiener(judge: Judge, line: float) -> None:
    """Means over midpoints of ever finer grids of the sensor's square."""
    ratio, pixel = 0.015, judge.drawn.camera.pixel_um
    worst, gain = [], []
    for samples in (48, 96):
        axis = (np.arange(samples) - (samples - 1) / 2) / (samples * pixel)
        x, y = (part.ravel() for part in np.meshgrid(axis, axis[samples // 2 :]))
        square = judge.drawn.modulation(line, x, y) ** 2
        lowest = np.sort(square / (square + ratio))
        count = 0.3 * lowest.size
        whole = int(count)
        worst.append((lowest[:whole].sum() + (count - whole) * lowest[whole]) / count)
        gain.append(math.sqrt(float(np.mean(square / (square + ratio) ** 2))))
    judge.check("wiener_worst30", float(worst[1]), line, doubt=abs(float(worst[1] - worst[0])) / 2)
    judge.check("wiener_noise_gain", gain[1], line, doubt=abs(gain[1] - gain[0]) / 2)


def scenes(judge: Judge) -> None:
    """What a plan says of its own error, of a band of light or of an object out of focus, against all of it."""
    drawn, draw = judge.drawn, judge.draw
    accuracy, camera = float(10 ** draw.uniform(-3.5, -1.5)), drawn.camera
    low = float(draw.uniform(420, 600))
    rows = np.array([low, low + draw.uniform(10, 90), low + draw.uniform(100, 200)])
    curve = Curve(rows, np.array([0.0, 1.0, float(draw.uniform(0, 1))]), "drawn")
    coloured = draw.random() < 0.6
    near = float(draw.uniform(3e4, 3e5))
    scene = Scene(bands=(Band((curve,), "drawn"),)) if coloured else Scene(nearest_um=near, farthest_um=near)
    plan = plan_scene(drawn.panel, camera, scene, accuracy)
    openings = panel_aperture(drawn.panel)
    die = Die("HUNTED", "HUNTED", drawn.panel, (0, 0), max(drawn.panel.size_nm))
    told = {q.name: q for q in measure_scene(die, camera, scene, openings, plan).quantities}
    # The shortest line of all, and the band: the plan's error is the larger one.
    errors = []
    shortest = rows[0] if coloured else min(camera.wavelengths_nm)
    alone = scene_psf(openings, camera, scene, plan, float(shortest), object_um=None if coloured else near)
    errors.append(_apart(drawn, alone, [(float(shortest), 1.0)], None if coloured else near))
    if coloured:
        # Simpson's rule on either side of the peak; the energy is the curve's own.
        places = [np.linspace(*ends, _BAND_LINES) for ends in (rows[:2], rows[1:])]
        weights = [_simpson(part) * np.interp(part, rows, curve.values) for part in places]
        spread = list(zip(np.concatenate(places).tolist(), np.concatenate(weights).tolist(), strict=True))
        errors.append(_apart(drawn, spectrum_psf(openings, camera, scene, plan, scene.bands[0]), spread, None))
    error = max(errors)
    measured = told["plan_error_measured"]
    judge.tell("plan_error_measured", float(measured), measured.uncertainty, error, size=accuracy)
    judge.tell("plan_error, at most", 0.0, float(told["plan_error"]), error, size=accuracy)


def _apart(drawn: Drawn, shown: Psf, lines: list[tuple[float, float]], object_um: float | None) -> float:
    """Relative L2 between a PSF and that of lines, each with its energy, of an object behind a thin lens."""
    axis = shown.step_um * (np.arange(shown.values.shape[0]) - shown.values.shape[0] // 2)
    total, energy = np.zeros(shown.values.shape), sum(weight for _, weight in lines)
    for line, weight in lines:
        scale = drawn.scale_um2(line)
        bend = None if object_um is None else 1 / (2e-3 * line * object_um)
        waves = None if bend is None else (lambda x, y, bend=bend: bend * (x**2 + y**2))
        field = drawn.slices.field(axis / scale, axis / scale, waves)
        total += weight / energy * (field.real**2 + field.imag**2) / scale**2
    total /= drawn.slices.energy_um2()
    return float(np.linalg.norm(shown.values - total) / np.linalg.norm(total))


def _simpson(places: np.ndarray) -> np.ndarray:
    weights = np.full(places.size, 2.0)
    weights[1::2] = 4.0
    weights[[0, -1]] = 1.0
    return weights * (places[1] - places[0])


def hunted(seed: int, number: int, *, quick: bool = False) -> list[Finding]:
    """All that is stated of one scene, or all that takes no lags by the thousand."""
    drawn = Drawn.of(seed, number)
    optics = drawn.stated()
    judge = Judge(drawn, optics.quantities, np.random.default_rng([seed, number, 1]))
    areas(judge)
    pictures(judge, optics.psfs)
    transfers(judge, optics, quick=quick)
    if drawn.tiny and not drawn.leak and not quick and judge.draw.random() < 0.25:
        scenes(judge)
    return judge.found


def table(found: Iterable[Finding]) -> Iterator[str]:
    """Rows of the manual's table."""
    by_name: dict[str, list[Finding]] = {}
    for finding in found:
        by_name.setdefault(finding.name, []).append(finding)
    yield "| number | checked | below the truth | median of stated over true | largest |"
    yield "|---|---|---|---|---|"
    for name, findings in by_name.items():
        ratios = sorted(finding.ratio for finding in findings)
        below = sum(finding.below for finding in findings)
        yield f"| {name} | {len(findings)} | {below} | {ratios[len(ratios) // 2]:.2g} | {ratios[-1]:.2g} |"


def _task(task: tuple[int, int]) -> list[Finding] | str:
    try:
        return hunted(*task)
    except JobError as error:
        return f"{task[1]}: {error}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    tasks = [(asked.seed, asked.first + k) for k in range(asked.scenes)]
    found: list[Finding] = []
    with ProcessPoolExecutor(asked.jobs) as pool:
        for told in pool.map(_task, tasks, chunksize=4):
            if isinstance(told, str):
                print("refused:", told, file=sys.stderr)
            else:
                found += told
    print("\n".join(table(found)))
    for finding in [finding for finding in found if finding.below][:200]:
        told = f"off by {finding.error:.3g}, stated {finding.bar:.3g}, doubt {finding.doubt:.2g}"
        print(f"below: scene {finding.scene}, {finding.name}: {told}", file=sys.stderr)
    return int(any(finding.below for finding in found))


if __name__ == "__main__":
    raise SystemExit(main())
