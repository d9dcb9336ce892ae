r"""The model bar: how far a PSF may be from the truth by what is not modelled, estimated for one die and one camera.

Every estimate is the relative L2 change of the point PSF over the camera's window at one line, from the die's own
field F and fields of the same openings with weights, to the lowest order of the effect. With a the amplitude of the
openings, s that of the clear stop, ρ = r / f, and I = |F[a]|² over its energy:

    chrome leak         |F[a] + τ F[s - a]|², |τ| = 10^(-OD / 2), at the phase of τ that changes most
    vector field        ½ |F[x a / f]|² + ½ |F[y a / f]|² - ½ Re F* F[ρ² a]     (Richards and Wolf, Proc. R. Soc. A 253,
                        358, 1959, unpolarised light, to second order)
    lens apodisation    amplitudes cos^½ θ and cos^-½ θ: ∓½ Re F* F[ρ² a], energies made equal again
    tangent for sine    image height f tan θ, not f sin θ: the picture moved by r³ / 2f² about the axis
    film walls          all widths less by their shade at the edge of the field, the film's thickness times tan θ
    glass               a gap t / n between openings and stop, by the angular spectrum
    ghosts              light thrown back by chrome and glass: a second picture, at worst elsewhere altogether
    CD bias             every edge moved by half the bias, its light put on the dots beside it

What a job states replaces what is assumed; each row says which.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from maskfab.base.arrays import Complexes, Floats
from maskfab.base.model import Panel, Quantity
from maskfab.base.quantities import columns
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.job.camera import Camera
from maskfab.job.process import Glass, MaskBlank
from maskfab.optics.field.matrix import SampledField
from maskfab.optics.field.methods import field
from maskfab.optics.gap import gap_change
from maskfab.optics.psf import Leak, image_scale_um2, odd_samples, point_step_um
from maskfab.optics.pupil import Aperture, Lattice, Pupil, cut, panel_aperture, zeros
from maskfab.optics.stop import clear_field, inside

MODEL_BAR = "model_"
"""Prefix of the names of the bar's rows."""

ASSUMED_FILM_UM = 0.1
"""Thickness of the chrome of masks, whose walls stand in the way of oblique light."""

ASSUMED_DENSITY = 3.0
"""Optical density of chrome that mask shops guarantee, at the lines of exposure; seldom stated for visible light."""

ASSUMED_GLASS = Glass(2286.0, 1.46, "away")
"""A plate of 90 mil of fused silica, on the worse side."""

ASSUMED_BIAS_UM = 0.2
"""Total CD tolerance of shops for plates of a few micrometres."""

CHROME_REFLECTS = 0.6
"""Share of visible light that bright chrome throws back; with an antireflective coat a tenth."""

_MOST_GAP_SIDE = 600
"""Dots across the stop that a gap is tried on, about; finer ones are gathered in squares."""

_GAP_DETAIL = 10
"""Dots along the finest width that the window's edge resolves: finer dots throw light that misses the window."""

_EVERY = 2
"""Of the PSF's samples along each axis one in so many is looked at: the field's own Nyquist distance, about."""

_PHASES = 360

_ROWS_AT_A_TIME = 128


@dataclass(frozen=True)
class Omission:
    """One thing that is not modelled.

    Attributes:
        size: relative L2 change of the PSF, estimated.
        method: how it was estimated, and what was assumed.
    """

    name: str
    size: float
    method: str


def model_bar(
    pupil: Pupil, camera: Camera, blank: MaskBlank, sampled: SampledField | None = None
) -> tuple[Omission, ...]:
    """Effects that the numbers of a die on the axis omit, the largest first; those of size 0 are not listed.

    Args:
        camera: what looks through the pupil; the middle one of its lines is taken.
        sampled: the pupil's field anywhere in the camera's window, where it is known.
    """
    return _by_size(_on_axis(_DieField.of(pupil, camera, sampled), blank))


def scene_bar(pupil: Pupil, camera: Camera, slope: float, blank: MaskBlank) -> tuple[Omission, ...]:
    """Effects that a scene omits besides those of the numbers on the axis, the largest first.

    These are what light from the side sees, the gap aside, and a leak that only the numbers on the axis hold.

    Args:
        slope: tan θ of the light from the edge of the field; 0 for the axis.
    """
    if not (slope or Leak.of(blank, camera.stop)):
        return ()
    return _by_size(_of_scene(_DieField.of(pupil, camera), slope, blank))


def bar_of_pupil(
    pupil: Pupil, camera: Camera, blank: MaskBlank, die: str | None, sampled: SampledField | None = None
) -> tuple[Quantity, ...]:
    """The bar of a pupil behind a camera, as rows of a report: the sum of all, then each; as :func:`model_bar`."""
    omissions = model_bar(pupil, camera, blank, sampled)
    total = Quantity(
        f"{MODEL_BAR}bar",
        sum(omission.size for omission in omissions),
        "sum of what is not modelled, each estimated as the relative L2 change of the PSF over the window at "
        f"{camera.middle_nm:g} nm; numerical errors stand beside each number",
        die=die,
    )
    return total, *rows_of(omissions, die)


def bar_of_scene(panel: Panel, camera: Camera, blank: MaskBlank, slope: float) -> tuple[Omission, ...]:
    """Omissions of a scene's PSFs, on the axis and off it, the largest first; of a field the plan tells the tangent."""
    pupil = cut(panel_aperture(panel, camera.stop.diameter_um / 2), camera.stop)
    die = _DieField.of(pupil, camera)
    axis = (omission for omission in _on_axis(die, blank) if not (slope and omission.name == "tangent for sine"))
    return _by_size([*axis, *_of_scene(die, slope, blank)])


def weighed(omissions: Sequence[Omission], accuracy: float) -> list[dict[str, object]]:
    """Omissions as plain data for JSON, and whether each is more than the admissible relative L2 error of the PSF."""
    return [
        {
            "name": omission.name,
            "error": omission.size,
            "above_accuracy": omission.size > accuracy,
            "method": omission.method,
        }
        for omission in omissions
    ]


def weighed_table(omissions: Sequence[Omission], accuracy: float) -> list[str]:
    """The omissions as lines of text; none for no omissions."""
    if not omissions:
        return []
    rows = [
        (omission.name, "matters" if omission.size > accuracy else "within", f"{omission.size:.1e}", omission.method)
        for omission in omissions
    ]
    above = sum(omission.size for omission in omissions if omission.size > accuracy)
    verdict = f"{above:.2g} of it matters beside the accuracy" if above else "all within the accuracy"
    return [f"not modelled, whatever is asked for: {verdict} of {accuracy:g}", *columns(rows)]


def rows_of(omissions: Sequence[Omission], die: str | None) -> tuple[Quantity, ...]:
    """A row of a report for each."""
    return tuple(
        Quantity(MODEL_BAR + omission.name.replace(" ", "_"), omission.size, omission.method, die=die)
        for omission in omissions
    )


@dataclass(frozen=True, eq=False)
class _DieField:
    """A die's field [n, n] and intensity on the samples of its PSF, and the axes of frequency from 0, cycles per µm."""

    pupil: Pupil
    camera: Camera
    u: Floats
    field: Complexes

    @classmethod
    def of(cls, pupil: Pupil, camera: Camera, sampled: SampledField | None = None) -> _DieField:
        line = camera.middle_nm
        camera = replace(camera, wavelengths_nm=(line,))
        step = point_step_um(camera)
        reach = odd_samples(camera.window_um, step) // 2
        u = step * np.arange(0, reach + 1, _EVERY, dtype=np.float64) / image_scale_um2(camera, line)
        seen = field(pupil, u, u) if sampled is None else sampled.field(u, u)
        return cls(pupil, camera, u, seen.amplitude())

    @property
    def line_nm(self) -> float:
        return self.camera.wavelengths_nm[0]

    @property
    def axis(self) -> Floats:
        """Frequencies of the whole grid, [n]."""
        return np.concatenate([-self.u[:0:-1], self.u])

    @cached_property
    def intensity(self) -> Floats:
        return _square(self.field) / self.pupil.energy_um2

    @property
    def openings(self) -> Aperture:
        """Openings before the stop, dots that it cuts whole; what it hides is dark."""
        clear = self.pupil.whole.copy()
        clear[self.pupil.rim_row, self.pupil.rim_column] = self.pupil.rim_transmission
        clear.flags.writeable = False
        return Aperture(self.pupil.x, self.pupil.y, clear, zeros(clear.shape))

    @property
    def open_ratio(self) -> float:
        return min(1.0, self.pupil.energy_um2 / self.camera.stop.area_um2)

    def weighted(self, weight: Floats) -> Complexes:
        """The field of the openings times a weight [ny, nx], the dots at the rim grey."""
        grey = self.pupil.mean_transmission * weight
        grey.flags.writeable = False
        plain = Pupil.of_whole_dots(self.pupil.x, self.pupil.y, grey, self.pupil.stop)
        return field(plain, self.u, self.u, "single").amplitude()

    def relative(self, change: Floats) -> float:
        """L2 of a change of the intensity, relative to the intensity."""
        return float(np.linalg.norm(change) / np.linalg.norm(self.intensity))


def _on_axis(die: _DieField, blank: MaskBlank) -> Iterator[Omission]:
    if Leak.of(blank, die.camera.stop) is None:
        yield leak_omission(die.field, die.pupil, die.axis, blank)
    yield from _lens(die)
    yield from _glass(die, blank)
    yield _ghosts(die, blank)
    yield _bias(die)


def _of_scene(die: _DieField, slope: float, blank: MaskBlank) -> Iterator[Omission]:
    if Leak.of(blank, die.camera.stop) is not None:
        yield leak_omission(die.field, die.pupil, die.axis, blank)
    if slope:
        shade = ASSUMED_FILM_UM * slope
        told = f"walls of a film of {ASSUMED_FILM_UM * NM_PER_UM:g} nm (assumed) shade {shade * NM_PER_UM:.3g} nm of "
        yield Omission("film walls", _of_widths(die, shade), told + "all widths, at most, at the edge of the field")


def _by_size(omissions: Iterable[Omission]) -> tuple[Omission, ...]:
    return tuple(sorted((omission for omission in omissions if omission.size > 0), key=lambda omission: -omission.size))


def _square(values: Complexes) -> Floats:
    return np.asarray(values.real**2 + values.imag**2)


def leak_omission(openings: Complexes, pupil: Pupil, axis: Floats, blank: MaskBlank) -> Omission:
    """The leak of a film as a plate states it; arguments as for :func:`leak_change`."""
    density = ASSUMED_DENSITY if blank.optical_density is None else blank.optical_density
    phase = blank.film_phase_waves
    size = leak_change(openings, pupil, axis, density, phase)
    source = "assumed, as mask houses promise" if blank.optical_density is None else "stated"
    at = "at the worst phase of the film, which nothing states" if phase is None else f"{phase:g} waves behind, stated"
    return Omission("chrome leak", size, f"optical density {density:g} ({source}), {at}")


def leak_change(
    openings: Complexes, pupil: Pupil, axis: Floats, density: float, phase_waves: float | None = None
) -> float:
    """Relative L2 change of a PSF by light that leaks through the film, the largest over its phases if that is None.

    Over the energies the change is A + B cos φ + C sin φ; the largest norm of that is found from their products.

    Args:
        openings: complex [n, n], the field without a leak.
        axis: frequencies of the grid, [n].
        phase_waves: by how much light through the film lags; its amplitude is turned by exp(2πi) to that power.
    """
    leak = 10 ** (-density / 2)
    film = clear_field(pupil.stop, axis, axis[:, None]) - openings
    energy = pupil.energy_um2
    with_film = energy + leak**2 * max(0.0, pupil.stop.area_um2 - energy)
    plain = _square(openings) / energy
    cross = 2 * leak * openings.conj() * film / with_film
    parts = np.stack(
        [(_square(openings) + leak**2 * _square(film)) / with_film - plain, cross.real, -cross.imag]
    ).reshape(3, -1)
    lags = np.arange(_PHASES) / _PHASES if phase_waves is None else np.array([phase_waves])
    turn = np.stack([np.ones(lags.size), np.cos(2 * np.pi * lags), np.sin(2 * np.pi * lags)])
    squared = np.einsum("ka,kl,la->a", turn, parts @ parts.T, turn)
    return float(np.sqrt(squared.max()) / np.linalg.norm(plain))


def _lens(die: _DieField) -> Iterator[Omission]:
    """Vector field, apodisation and the sine condition, which share their fields."""
    focal, energy = die.camera.focal_um, die.pupil.energy_um2
    x, y = ((edges[1:] + edges[:-1]) / 2 / focal for edges in (die.pupil.x.edges_um(), die.pupil.y.edges_um()))
    along_x, along_y = (
        die.weighted(np.broadcast_to(x, (y.size, x.size))),
        die.weighted(np.broadcast_to(y[:, None], (y.size, x.size))),
    )
    square = x**2 + y[:, None] ** 2
    second = (die.field.conj() * die.weighted(square)).real / energy
    number = die.camera.focal_um / die.camera.stop.diameter_um
    vector = (_square(along_x) + _square(along_y)) / (2 * energy) - second / 2
    yield Omission("vector field", die.relative(vector), f"unpolarised light focused at f/{number:.3g}, second order")
    widths, heights = np.diff(die.pupil.x.edges_um()), np.diff(die.pupil.y.edges_um())
    spread = float(heights @ (die.pupil.mean_transmission * square) @ widths) / energy
    apodised = (second - spread * die.intensity) / 2
    yield Omission("lens apodisation", die.relative(apodised), "amplitude cos^½ θ or cos^-½ θ over the stop")
    scale = image_scale_um2(die.camera, die.line_nm)
    place = scale * die.axis
    radius = (place**2 + place[:, None] ** 2) / focal**2
    # dF/dx = -2πi / (λf) F[x a], and the weights hold x / f.
    slope = 4 * np.pi * focal / scale / energy
    falls = slope * (place * (die.field.conj() * along_x).imag + place[:, None] * (die.field.conj() * along_y).imag)
    moved = radius * (falls / 2 + 2 * die.intensity)
    told = "a lens without distortion, image height f tan θ, over the window"
    yield Omission("tangent for sine", die.relative(moved), told)


def _glass(die: _DieField, blank: MaskBlank) -> Iterator[Omission]:
    glass = blank.glass or ASSUMED_GLASS
    if glass.gap_um == 0:
        return
    inner = die.u[: die.u.size // 2 + 1]
    size = gap_change(_coarse(die), die.camera, die.line_nm, glass.gap_um, inner)
    origin = "stated" if blank.glass else "assumed"
    yield Omission(
        "glass",
        size,
        f"{glass.thickness_um / UM_PER_MM:.4g} mm of index {glass.index:g}, chrome away from the lens ({origin}): a "
        f"gap of {glass.gap_um / UM_PER_MM:.3g} mm by the angular spectrum, over the window's middle half, within a "
        "factor of two",
    )


def _coarse(die: _DieField) -> Aperture:
    """The openings with dots in squares gathered to one, as far as the window does not tell them apart."""
    openings = die.openings
    x, y = openings.x, openings.y
    widest = image_scale_um2(die.camera, die.line_nm) / die.camera.window_um
    sample = max(die.camera.stop.diameter_um / _MOST_GAP_SIDE, widest / _GAP_DETAIL)
    factor = int(min(sample, widest) / x.dot_um)
    if factor < 2 or x.has_gutter or y.has_gutter:
        return openings
    spare = [(axis.cells * axis.dots) % (2 * factor) // 2 for axis in (x, y)]
    counts = [axis.cells * axis.dots // (2 * factor) * 2 for axis in (x, y)]
    clear = openings.transmission[spare[1] :, spare[0] :][: counts[1] * factor, : counts[0] * factor]
    means = clear.reshape(counts[1], factor, counts[0], factor).mean(axis=(1, 3))
    along_x, along_y = (
        Lattice(axis.start_um + skip * axis.dot_um, count, 1, factor * axis.dot_um, factor * axis.dot_um)
        for axis, skip, count in zip((x, y), spare, counts, strict=True)
    )
    return Aperture(along_x, along_y, means, zeros(means.shape))


def _ghosts(die: _DieField, blank: MaskBlank) -> Omission:
    glass = blank.glass or ASSUMED_GLASS
    surface = ((glass.index - 1) / (glass.index + 1)) ** 2
    back = CHROME_REFLECTS * (1 - die.open_ratio) + surface * die.open_ratio
    share = surface * back
    return Omission(
        "ghosts",
        math.sqrt(2) * share,
        f"at most: {share:.2g} of the light comes back from bright chrome (reflecting {CHROME_REFLECTS:g}, assumed) "
        f"and a surface of index {glass.index:g}, and falls elsewhere",
    )


def _bias(die: _DieField) -> Omission:
    told = f"clear widths {ASSUMED_BIAS_UM * NM_PER_UM:g} nm off everywhere (assumed)"
    return Omission("cd bias", _of_widths(die, ASSUMED_BIAS_UM), told)


def _of_widths(die: _DieField, change_um: float) -> float:
    """Size of a change of all clear widths, as light put on the dots beside their edges."""
    openings = die.openings
    clear = openings.transmission
    beside = np.zeros(clear.shape)
    beside[1:] += clear[:-1]
    beside[:-1] += clear[1:]
    beside[:, 1:] += clear[:, :-1]
    beside[:, :-1] += clear[:, 1:]
    x, y = ((edges[1:] + edges[:-1]) / 2 for edges in (openings.x.edges_um(), openings.y.edges_um()))
    for start in range(0, y.size, _ROWS_AT_A_TIME):
        rows = slice(start, start + _ROWS_AT_A_TIME)
        beside[rows] *= 1 - clear[rows]
        beside[rows] *= change_um / 2 / openings.x.dot_um
        beside[rows] *= inside(die.camera.stop, x, y[rows, None])
    beside.flags.writeable = False
    wider = Pupil.of_whole_dots(openings.x, openings.y, beside, die.camera.stop)
    change = field(wider, die.u, die.u, "single").amplitude()
    more = 2 * (die.field.conj() * change).real / die.pupil.energy_um2
    gained = wider.field_integral_um2 / die.pupil.energy_um2
    return die.relative(more - gained * die.intensity)
