"""The eye in front of a display: S-CIELAB, appearance, grain, and ColorVideoVDP for whoever has it.

**S-CIELAB**, how different two pictures look from where they are looked at: Zhang and Wandell, "A spatial extension of
CIELAB for digital color-image reproduction", SID Symposium Digest 27 (1996) and Journal of the SID 5 (1997). The light
is split into a luminance and two opponent-colour channels (Poirson and Wandell), each is blurred by a sum of Gaussians
k exp(-(r/s)^2) whose spreads s are degrees of visual angle, and the result is compared in CIELAB. The weights k are
scaled to sum to 1 in each channel, so an even field keeps its colour. The Fourier transform of exp(-(r/s)^2) / (pi s^2)
is exp(-(pi s f)^2): here the blur is that product, exact, and no kernel is cut off. The picture repeats beyond its
edges.

**Appearance**, to be shown magnified to a reader. S-CIELAB's own filtered picture is a step of a calculation: its
luminance channel takes away a part of the surround, and grey is not zero in its opponent channels, so that black and
white edges come out tinted. Here the luminance passes the two narrow Gaussians of that model's luminance channel, and
what a colour has beyond grey passes its red-green channel: greys stay grey, and colour is blurred more than lightness,
as the eye blurs them.

**Grain**, the unevenness of an even field when neighbouring pixels are turned differently.

Derivation of the formula. Let every pixel send its luminance, on average over the wavelength of slow grain, from one
point: the luminance-weighted centroid of its emitters, off the pixel's centre by c_j (in pixels) for pixel j. To first
order in f c the transform of the field is that of the lattice, which the eye does not see, plus

    -2 pi i sum_j (f . d_j) exp(-2 pi i f . r_j),     d_j = c_j - mean of c.

The mean offset moves the whole picture and makes no grain. For independent orientations the terms add in power, and
turning by 90 degrees or a mean over directions gives E[(f . d)^2] = f^2 E[|d|^2] / 2. So with the pixel as unit of
length, and mean luminance 1,

    PSD(f) = (2 pi f)^2 |c|^2 / 2,                        |c|^2 = E[|d|^2],
    rms^2  = integral from 0 to F of PSD(f) 2 pi f df = (2 pi)^3 |c|^2 F^4 / 8,
    rms    = (2 pi)^1.5 / sqrt(8) F^2 |c| = 5.568 (F / ppd)^2 |c|

for F cycles per degree and ppd pixels per degree. Next come terms of order (f c)^2 and the emitters' own extent: below
about |c| = 0.02 pixel they are as large as the first.

**ColorVideoVDP** (the extra ``eye``): Mantiuk, Hanji, Ashraf, Asano and Chapiro, "ColorVideoVDP: a visual
difference predictor for image, video and display distortions", ACM Trans. Graph. 43 (2024). 10 JOD is no difference; 1
JOD less is seen by three of four observers.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType, ModuleType

import numpy as np

from maskfab.base.arrays import Floats, Singles
from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.model import ORIENTATIONS, Emitters, Panel, Quantity, frozen, orient
from maskfab.display import pictures
from maskfab.display.emitted_light import EmittedLight, Series, Tiled, Viewing, emitters_of, ideal, series
from maskfab.display.emitter_rules import EmitterRules
from maskfab.display.pictures import Picture, on_pixels
from maskfab.display.reference import Reference
from maskfab.display.surround import BORDER, Surrounded
from maskfab.optics.colour import (
    JUST_NOTICEABLE,
    LUMINANCE,
    XYZ_OF_RGB,
    delta_e_1976,
    lab_of_linear_srgb,
    luminance_centroid,
)

# Luminance, red-green, blue-yellow; from CIE XYZ.
_OPPONENT_OF_XYZ = ((0.279, 0.72, -0.107), (-0.449, 0.29, -0.077), (0.086, -0.59, 0.501))
OPPONENT_OF_RGB = frozen(np.array(_OPPONENT_OF_XYZ) @ XYZ_OF_RGB)
"""Of linear sRGB, [3, 3]."""
GAUSSIANS: tuple[tuple[tuple[float, float], ...], ...] = (
    ((0.921, 0.0283), (0.105, 0.133), (-0.108, 4.336)),
    ((0.531, 0.0392), (0.330, 0.494)),
    ((0.488, 0.0536), (0.371, 0.386)),
)
"""Weight and spread in degrees of each Gaussian, channel by channel."""

_FLOOR = 1e-12
HIGHEST_CPD = math.sqrt(-math.log(_FLOOR)) / (math.pi * 0.0283)
"""Above this no channel passes more than 1e-12 (59.1 cycles per degree)."""


@dataclass(frozen=True, eq=False)
class ColourDifference:
    """Difference of two pictures, float64 [y, x] CIE 1976 (2.3 is just noticeable), and its part in a* and b* alone."""

    delta_e: Floats
    colour: Floats

    @property
    def mean(self) -> float:
        return float(self.delta_e.mean())

    @property
    def worst_twentieth(self) -> float:
        """The 95th percentile of the colour difference."""
        return float(np.quantile(self.delta_e, 0.95))

    @property
    def fringe(self) -> float:
        """The largest difference in a* and b*: at an edge between greys, its colour fringe."""
        return float(self.colour.max())


def of_series(spectrum: Series, viewing: Viewing) -> Floats:
    """CIE L*a*b* of light after the eye's blur, [y, x, 3] against the white of sRGB, row 0 the lowest.

    Args:
        spectrum: of the light, up to :data:`HIGHEST_CPD`; samples lie as :func:`carrying` says.
    """
    samples = carrying(HIGHEST_CPD, viewing)
    blurred = spectrum.filtered(gains, OPPONENT_OF_RGB).values(samples)
    rgb = np.moveaxis(np.tensordot(np.linalg.inv(OPPONENT_OF_RGB), blurred, axes=1), 0, -1)
    return lab_of_linear_srgb(rgb)


def colour_difference(first: Floats, second: Floats) -> ColourDifference:
    """The colour difference at every sample of two pictures [y, x, 3] in L*a*b*."""
    return ColourDifference(delta_e_1976(first, second), np.asarray(np.linalg.norm((first - second)[..., 1:], axis=-1)))


def gains(radius_cpd: Floats) -> Floats:
    """Transmission of each channel, [3, ...] of cycles per degree [...]; 1 at 0."""
    return np.stack([_gain(channel, radius_cpd) for channel in GAUSSIANS])


def carrying(highest_cpd: float, viewing: Viewing) -> int:
    """Fewest samples along a pixel that carry frequencies up to ``highest_cpd``, and at least two."""
    return max(2, math.floor(2 * highest_cpd / viewing.pixels_per_degree) + 1)


def appearance(spectrum: Series, viewing: Viewing) -> Floats:
    """Linear light [y, x, 3] after the eye's blur, row 0 the lowest, on samples that carry all of it."""
    radius = spectrum.radius_cpd
    lightness, colour = _gain(GAUSSIANS[0][:2], radius), _gain(GAUSSIANS[1], radius)
    grey = np.broadcast_to(LUMINANCE, (3, 3))
    light = spectrum.filtered(lambda _: lightness, grey).values(carrying(HIGHEST_CPD, viewing))
    rest = spectrum.filtered(lambda _: colour, np.eye(3) - grey).values(carrying(HIGHEST_CPD, viewing))
    return np.moveaxis(light + rest, 0, -1)


def _gain(gaussians: tuple[tuple[float, float], ...], radius_cpd: Floats) -> Floats:
    passed = sum(weight * np.exp(-((np.pi * spread * radius_cpd) ** 2)) for weight, spread in gaussians)
    return np.asarray(passed / sum(weight for weight, _ in gaussians))


SLOW_CPD = 10.0
"""Grain slower than this many cycles per degree is what the eye sees best."""
FINE_CPD = 30.0
"""Grain finer than this is lost to most eyes."""

DEFAULT_GRAIN = 0.015
"""Slow grain that is just noticeable: the contrast of a spot of 16 mm², about a camera's window, that is (SEMI D31)."""

CONSTANT: float = (2 * math.pi) ** 1.5 / math.sqrt(8)


def centroids(panel: Panel) -> tuple[Floats, float]:
    """Mean (x, y) of the centroids of a panel's pixels off their centres, and their rms distance from it, in pixels.

    The mean moves the whole picture; the rms is |c| of the formula: 0 if all pixels have one orientation, the length of
    the centroid's offset if all eight are equally frequent.
    """
    places = np.array(
        [
            luminance_centroid(Emitters(orient(emitters.labels, turn), emitters.cell_nm), panel.pitch_nm)
            for emitters in emitters_of(panel)
            for turn in range(ORIENTATIONS)
        ]
    )
    used = np.bincount(panel.orientations.ravel(), minlength=len(places))
    share = used / used.sum()
    mean = share @ places
    return mean, float(math.sqrt(share @ ((places - mean) ** 2).sum(axis=1)))


def predicted_rms(offset_px: float, viewing: Viewing) -> float:
    """Slow grain, as rms luminance contrast, of a flat white field of independently turned pixels."""
    return float(CONSTANT * (SLOW_CPD / viewing.pixels_per_degree) ** 2 * offset_px)


def measured_rms(spectrum: Series, low_cpd: float, high_cpd: float) -> float:
    """rms luminance contrast of a flat field's light, known to ``high_cpd`` or more, between two frequencies."""
    luminance = np.tensordot(LUMINANCE, spectrum.coefficients, axes=1)
    mean = luminance[len(spectrum.y_cpd) // 2, 0].real
    inside = (spectrum.radius_cpd > low_cpd) & (spectrum.radius_cpd <= high_cpd)
    # A column x > 0 stands for its conjugate at -x too.
    times = np.where(spectrum.x_cpd > 0, 2.0, 1.0)
    power = (np.abs(luminance) ** 2 * times)[inside].sum()
    return float(math.sqrt(power) / mean)


WHITE_CD_M2 = 500.0
"""Luminance of the display's white, on the mean over a pixel."""
_PASS_CPD, _STOP_CPD = 40.0, 50.0


def metric() -> ModuleType:
    """The installed ``pycvvdp``. Raises JobError MF152 if it is not installed, MF121 if it cannot be imported."""
    require("eye", what="JOD", where="--jod", otherwise="leave --jod out")
    try:
        return importlib.import_module("pycvvdp")
    except ImportError as problem:
        what = f"JOD needs ColorVideoVDP, which cannot be imported ({problem})"
        cure = "Install it anew, or leave --jod out"
        raise JobError("MF121", what, where="--jod", cure=cure) from None


def jod(test: Series, reference: Series, viewing: Viewing) -> float:
    """Quality of a display in just-objectionable differences, at most 10.

    Args:
        test: what the display shows, up to 50 cycles per degree or more.
        reference: the same picture on an ideal display, of as many pixels.

    Notes:
        The metric takes the pixel lattice at some 60 cycles per degree for a visible pattern, so frequencies from 40 to
        50 are faded out and higher ones removed before it sees the light. It wants absolute luminance (relative light
        is below its threshold everywhere, and all is 10.00), a linear EOTF, and a peak that clips nothing.
    """
    library = metric()
    shown = [_absolute(light, viewing) for light in (test, reference)]
    rows, columns = shown[0].shape[:2]
    samples_per_degree = carrying(_STOP_CPD, viewing) * viewing.pixels_per_degree
    photometry = library.vvdp_display_photo_eotf(
        float(max(light.max() for light in shown)), contrast=1e6, source_colorspace="BT.709", EOTF="linear"
    )
    geometry = library.vvdp_display_geometry((columns, rows), ppd=samples_per_degree)
    judge = library.cvvdp(display_photometry=photometry, display_geometry=geometry)
    quality, _ = judge.predict(*shown, dim_order="HWC")
    return float(quality)


def _absolute(light: Series, viewing: Viewing) -> Singles:
    """Luminous light [y, x, 3] in cd/m2, top row first, without what is finer than the eye resolves."""
    values = light.up_to(_STOP_CPD).filtered(_fade).values(carrying(_STOP_CPD, viewing))
    # Fading out rings a little; light is never negative.
    lit = np.maximum(np.moveaxis(values, 0, -1)[::-1], 0.0) * WHITE_CD_M2
    return np.ascontiguousarray(lit, dtype=np.float32)


def _fade(radius_cpd: Floats) -> Floats:
    part = np.clip((radius_cpd - _PASS_CPD) / (_STOP_CPD - _PASS_CPD), 0.0, 1.0)
    return np.asarray(0.5 + 0.5 * np.cos(np.pi * part))


FLAT, EDGE, ZONE, TEXT, LEAVES, PICTURE = "flat", "edge", "zone_plate", "text", "leaves", "picture"
FEWEST_PIXELS = 8
"""Along a side of a target."""
_MOST = 1000


@dataclass(frozen=True, eq=False)
class PictureView:
    """One picture on one panel.

    Attributes:
        seen: linear light [y, x, 3] as it appears to the eye, row 0 the lowest, for a reader to look at.
        reference: the same of an ideal display.
        delta_e_aligned: its mean after the reference moved by the mean centroid of the pixels.
        fringe: largest difference in a* and b* after that move.
    """

    seen: Singles
    reference: Singles
    samples: int
    delta_e: float
    delta_e_95: float
    delta_e_aligned: float
    fringe: float
    jod: float | None


@dataclass(frozen=True, eq=False)
class SeenPanel:
    """A panel, every picture on it (linear light by pixel, and as it is seen), and its numbers.

    The last picture is an even field with the panel in the middle of the regular display.
    """

    name: str
    panel: Panel
    viewing: Viewing
    images: Mapping[str, Floats]
    views: Mapping[str, PictureView]
    quantities: tuple[Quantity, ...]
    surrounded: Surrounded

    def light(self, title: str, samples: int) -> EmittedLight:
        """Light of one of the pictures, ``samples`` along a pixel."""
        return self.shown(title).light(self.images[title], samples)

    def shown(self, title: str) -> Tiled:
        """Pixels that one of the pictures is on."""
        return self.surrounded.tiled if title == BORDER else Tiled.of(self.panel, *self.images[title].shape[:2])


def target_pictures(pixels: int, photograph: Picture | None = None) -> dict[str, Floats]:
    """The targets by name, and a photograph in place of the leaves if there is one."""
    if not FEWEST_PIXELS <= pixels <= _MOST:
        what = f"{pixels} pixels along a side are outside {FEWEST_PIXELS} to {_MOST}"
        raise JobError("MF121", what, where="pixels", cure="Use 100")
    shown = {
        FLAT: pictures.flat(pixels),
        EDGE: pictures.edge(pixels),
        ZONE: pictures.zone_plate(pixels),
        TEXT: pictures.text(pixels),
    }
    if photograph is None:
        return {**shown, LEAVES: pictures.leaves(pixels)}
    return {**shown, PICTURE: on_pixels(photograph, pixels, pixels)}


def judge(
    name: str,
    panel: Panel,
    images: Mapping[str, Floats],
    samples: int,
    viewing: Viewing,
    *,
    reference: Reference | None = None,
    with_jod: bool = False,
    limits: Mapping[str, float] = MappingProxyType({}),
) -> SeenPanel:
    """Show every image on a panel and look at it.

    Args:
        images: by name, [rows, columns, 3] linear light; grain is measured on ``flat``.
        samples: along the side of a pixel, of the light that is written and of the field at the die's border.
        viewing: its pitch may differ from the panel's own: then the whole panel is seen scaled to it.
        reference: the regular display round the die; by default three stripes, each a third of the pixel.
        limits: of quantities, by name; whether they are kept is told.

    Raises:
        JobError: MF121, MF119, MF115 for what cannot be shown.
    """
    if with_jod:
        metric()
    _, offset = centroids(panel)
    predicted = predicted_rms(offset, viewing)
    own = [
        Quantity("pixels_per_degree", viewing.pixels_per_degree, "distance x 1 degree / pitch", die=name),
        Quantity("centroid_offset", offset, "emitters' luminance centroid, rms off its mean", die=name),
        Quantity("grain_predicted", predicted, "5.568 (F/ppd)^2 |c|, F = 10 cy/deg", die=name),
    ]
    views = {}
    most = max(max(image.shape[:2]) for image in images.values())
    shift_x, shift_y = Tiled.of(panel, *next(iter(images.values())).shape[:2]).centroid
    regular = reference or Reference.of("stripe", panel.pitch_nm, EmitterRules(0, 0, 1))
    surrounded = Surrounded.of(panel, regular, most, samples, carrying(HIGHEST_CPD, viewing))
    images = {**images, BORDER: surrounded.image}
    for title, image in images.items():
        shown = surrounded.tiled if title == BORDER else Tiled.of(panel, *image.shape[:2])
        perfect = ideal(image, 1, shown.pitch_um)  # its series is as exact with one sample as with many
        spectrum = shown.series(image, viewing, HIGHEST_CPD)
        even = series(perfect, viewing, HIGHEST_CPD)
        lab, even_lab = of_series(spectrum, viewing), of_series(even, viewing)
        moved = of_series(even.displaced(shift_x, shift_y), viewing)
        quality = jod(spectrum, even, viewing) if with_jod else None
        plain, aligned = colour_difference(lab, even_lab), colour_difference(lab, moved)
        view = PictureView(
            appearance(spectrum, viewing).astype(np.float32),
            appearance(even, viewing).astype(np.float32),
            carrying(HIGHEST_CPD, viewing),
            plain.mean,
            plain.worst_twentieth,
            aligned.mean,
            aligned.fringe,
            quality,
        )
        views[title] = view
        if title == FLAT:
            for word, low, high in (("slow", 0.0, SLOW_CPD), ("fine", SLOW_CPD, FINE_CPD)):
                rms = measured_rms(spectrum, low, high)
                method = f"rms luminance contrast of an even field, {low:g} to {high:g} cy/deg"
                own.append(Quantity(f"grain_{word}", rms, method, die=name))
        own.extend(
            surrounded.quantities(name, lab, even_lab, viewing) if title == BORDER else _numbers(name, title, view)
        )
    told = tuple(_limited(quantity, limits.get(quantity.name)) for quantity in own)
    return SeenPanel(name, panel, viewing, images, views, told, surrounded)


def _limited(quantity: Quantity, limit: float | None) -> Quantity:
    return quantity if limit is None else replace(quantity, limit=limit, passed=float(quantity) <= limit)


def _numbers(name: str, title: str, view: PictureView) -> list[Quantity]:
    known = (
        f"; {JUST_NOTICEABLE:g} is just noticeable (Mahy, Van Eycken and Oosterlinck, 1994), up to 1 is not seen"
        if title == FLAT
        else ""
    )
    numbers = [
        ("_delta_e_mean", view.delta_e, f"S-CIELAB, CIE 1976, mean{known}"),
        ("_delta_e_95", view.delta_e_95, "the same, 95th percentile"),
        ("_delta_e_aligned", view.delta_e_aligned, "mean, the common shift of all pixels removed"),
    ]
    if title == EDGE:
        numbers.append(("_fringe", view.fringe, "largest S-CIELAB difference in a* and b*, the common shift removed"))
    if view.jod is not None:
        numbers.append(("_jod", view.jod, "ColorVideoVDP, white 500 cd/m2"))
    return [Quantity(f"{title}{key}", value, method, die=name) for key, value, method in numbers]
