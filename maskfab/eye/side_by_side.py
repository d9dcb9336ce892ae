"""Panels side by side: what each picture looks like on each of them, and how far that is from an ideal display."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.eye import drawn_scenes, grain, jod, scielab
from maskfab.eye.appearance import appearance
from maskfab.eye.display_light import ideal, show
from maskfab.eye.fourier_light import series
from maskfab.eye.picture import Picture, on_pixels
from maskfab.eye.viewing import Viewing
from maskfab.model import Panel, Quantity

FLAT, EDGE, ZONE, TEXT, LEAVES, PICTURE = "flat", "edge", "zone_plate", "text", "leaves", "picture"
_FEWEST, _MOST = 8, 1000


@dataclass(frozen=True, eq=False)
class PictureView:
    """One picture on one panel.

    Attributes:
        seen: linear light [y, x, 3] as it appears to the eye, row 0 the lowest, for a reader to look at.
        reference: the same of an ideal display.
        samples: along a pixel, of both.
        delta_e: mean S-CIELAB difference of the two.
        delta_e_95: its 95th percentile.
        delta_e_aligned: its mean after the reference moved by the panel's mean centroid.
        fringe: largest difference in a* and b* after that move.
        jod: ColorVideoVDP's judgement; None if it was not asked.
    """

    seen: NDArray[np.float32]
    reference: NDArray[np.float32]
    samples: int
    delta_e: float
    delta_e_95: float
    delta_e_aligned: float
    fringe: float
    jod: float | None


@dataclass(frozen=True, eq=False)
class SeenPanel:
    """A panel, every picture on it (linear light by pixel, and as it is seen), and its numbers."""

    name: str
    panel: Panel
    viewing: Viewing
    images: Mapping[str, Floats]
    views: Mapping[str, PictureView]
    quantities: tuple[Quantity, ...]


def target_pictures(pixels: int, photograph: Picture | None = None) -> dict[str, Floats]:
    """The targets by name, and a photograph in place of the leaves if there is one.

    Raises:
        JobError: MF121 if there are fewer than 8 pixels or absurdly many, or the photograph cannot be shown.
    """
    if not _FEWEST <= pixels <= _MOST:
        raise JobError(
            "MF121",
            f"{pixels} pixels along a side are outside {_FEWEST} to {_MOST}",
            where="pixels",
            cure="Use 100",
        )
    shown = {
        FLAT: drawn_scenes.flat(pixels),
        EDGE: drawn_scenes.edge(pixels),
        ZONE: drawn_scenes.zone_plate(pixels),
        TEXT: drawn_scenes.text(pixels),
    }
    if photograph is None:
        return {**shown, LEAVES: drawn_scenes.leaves(pixels)}
    return {**shown, PICTURE: on_pixels(photograph, pixels, pixels)}


def judge(
    name: str, panel: Panel, images: Mapping[str, Floats], samples: int, viewing: Viewing, *, with_jod: bool = False
) -> SeenPanel:
    """Show every image on a panel and look at it.

    Args:
        name: the die's.
        panel: with emitters.
        images: by name, [rows, columns, 3] linear light; grain is measured on ``flat``.
        samples: along the side of a pixel.
        viewing: its pitch may differ from the panel's own: then the whole panel is seen scaled to it.
        with_jod: ask ColorVideoVDP too.

    Raises:
        JobError: MF121, MF119, MF115 for what cannot be shown.
    """
    if with_jod:
        jod.metric()
    (shift_x, shift_y), offset = grain.centroids(panel)
    predicted = grain.predicted_rms(offset, viewing)
    own = [
        Quantity("pixels_per_degree", viewing.pixels_per_degree, "distance x 1 degree / pitch", die=name),
        Quantity("centroid_offset", offset, "emitters' luminance centroid, rms off its mean", die=name),
        Quantity("grain_predicted", predicted, "5.568 (F/ppd)^2 |c|, F = 10 cy/deg", die=name),
    ]
    views = {}
    for title, image in images.items():
        light = show(panel, image, samples)
        perfect = ideal(image, 1, light.pitch_um)  # its series is as exact with one sample as with many
        spectrum = series(light, viewing, scielab.HIGHEST_CPD)
        even = series(perfect, viewing, scielab.HIGHEST_CPD)
        lab, reference = scielab.of_series(spectrum, viewing), scielab.of_series(even, viewing)
        moved = scielab.of_series(even.displaced(shift_x, shift_y), viewing)
        quality = jod.jod(light, perfect, viewing) if with_jod else None
        plain, aligned = scielab.colour_difference(lab, reference), scielab.colour_difference(lab, moved)
        view = PictureView(
            appearance(spectrum, viewing).astype(np.float32),
            appearance(even, viewing).astype(np.float32),
            scielab.carrying(scielab.HIGHEST_CPD, viewing),
            plain.mean,
            plain.worst_twentieth,
            aligned.mean,
            aligned.fringe,
            quality,
        )
        views[title] = view
        if title == FLAT:
            for word, low, high in (("slow", 0.0, grain.SLOW_CPD), ("fine", grain.SLOW_CPD, grain.FINE_CPD)):
                rms = grain.measured_rms(spectrum, low, high)
                method = f"rms luminance contrast of an even field, {low:g} to {high:g} cy/deg"
                own.append(Quantity(f"grain_{word}", rms, method, die=name))
        own.extend(_numbers(name, title, view))
    return SeenPanel(name, panel, viewing, images, views, tuple(own))


def _numbers(name: str, title: str, view: PictureView) -> list[Quantity]:
    found = [
        Quantity(f"{title}_delta_e_mean", view.delta_e, "S-CIELAB, CIE 1976, mean", die=name),
        Quantity(f"{title}_delta_e_95", view.delta_e_95, "the same, 95th percentile", die=name),
        Quantity(
            f"{title}_delta_e_aligned", view.delta_e_aligned, "mean, the common shift of all pixels removed", die=name
        ),
    ]
    if title == EDGE:
        method = "largest S-CIELAB difference in a* and b*, the common shift removed"
        found.append(Quantity("edge_fringe", view.fringe, method, die=name))
    if view.jod is not None:
        found.append(Quantity(f"{title}_jod", view.jod, "ColorVideoVDP, white 500 cd/m2", die=name))
    return found
