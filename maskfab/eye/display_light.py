"""The light that leaves a display: every pixel's red, green and blue from where its emitters really are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.errors import JobError
from maskfab.model import COLOURS, ORIENTATIONS, Emitters, Opening, Panel, frozen, orient

MOST_SAMPLES = 1 << 24
"""Samples of one picture; three colours of them and their transforms stay under 1.5 GB."""


@dataclass(frozen=True, eq=False)
class EmittedLight:
    """Emitted light on square samples, each the exact mean over its own area.

    Attributes:
        rgb: float64 [3, y, x], row 0 the lowest; linear-light red, green and blue with the primaries of sRGB. The mean
            over a pixel is what the picture asks of it, so a white picture has the mean 1.
        samples: along the side of a pixel.
        pitch_um: from pixel to pixel.
    """

    rgb: Floats
    samples: int
    pitch_um: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "rgb", frozen(self.rgb))

    @property
    def pixels(self) -> tuple[int, int]:
        """Rows and columns of pixels."""
        return self.rgb.shape[1] // self.samples, self.rgb.shape[2] // self.samples


def show(panel: Panel, image: Floats, samples: int) -> EmittedLight:
    """The image on the pixels in the middle of a panel.

    Every emitter is driven so that the pixel sends out the colour asked for, whatever the emitters' areas (a small one
    is brighter). Openings and gutters are dark.

    Args:
        panel: with emitters.
        image: [rows, columns, 3] linear light 0 to 1, one value per pixel, row 0 the lowest.
        samples: along the side of a pixel.

    Raises:
        JobError: MF121 if the panel has no emitters or too few pixels, or the image is none; MF119 if an emitter lies
            over an opening or off the grid of dots; MF115 if there would be too many samples.
    """
    rows, columns = _checked(image)
    high, wide = panel.orientations.shape
    if rows > high or columns > wide:
        raise JobError(
            "MF121",
            f"the picture has {columns} x {rows} pixels and the panel {wide} x {high}",
            where="pixels",
            cure=f"Show at most {min(high, wide)} x {min(high, wide)} pixels, or make the panel larger",
        )
    _check_samples(rows, columns, samples)
    bottom, left = (high - rows) // 2, (wide - columns) // 2
    turned = panel.orientations[bottom : bottom + rows, left : left + columns]
    tiles = emission(panel, samples)
    rgb = np.empty((3, rows, samples, columns, samples))
    for colour in range(3):
        # One row of pixels at a time keeps the gathered tiles small.
        for row in range(rows):
            lit = tiles[turned[row], colour] * image[row, :, colour, None, None]
            rgb[colour, row] = lit.transpose(1, 0, 2)
    return EmittedLight(_still(rgb.reshape(3, rows * samples, columns * samples)), samples, panel.cell_size.pitch_um)


def ideal(image: Floats, samples: int, pitch_um: float) -> EmittedLight:
    """The image on a display whose pixels shine evenly over all of their area in every colour: the reference.

    Raises:
        JobError: MF121, MF115 as for :func:`show`.
    """
    _check_samples(*_checked(image), samples)
    even = np.repeat(np.repeat(np.moveaxis(image, -1, 0), samples, axis=1), samples, axis=2)
    return EmittedLight(_still(even), samples, pitch_um)


def emission(panel: Panel, samples: int) -> Floats:
    """Light distribution of every possible cell content, [8 openings, 3, samples, samples], of mean 1 per colour.

    Notes:
        A sample that an emitter covers in part takes its share of the area, so the means are exact on any grid.

    Raises:
        JobError: MF121, MF119 as for :func:`emitters_of`.
    """
    bounds = np.linspace(0.0, panel.pitch_nm, samples + 1)
    tiles = []
    for emitters in emitters_of(panel):
        # Half a gutter, the cells, half a gutter; the ends are common to every sample grid.
        edges = panel.gutter_nm / 2 + emitters.cell_nm * np.arange(len(emitters.labels) + 1.0)
        shared = np.minimum(bounds[1:, None], edges[1:]) - np.maximum(bounds[:-1, None], edges[:-1])
        share = np.maximum(shared, 0.0) * (samples / panel.pitch_nm)
        for turn in range(ORIENTATIONS):
            labels = orient(emitters.labels, turn)
            covered = np.stack([share @ (labels == colour) @ share.T for colour in (1, 2, 3)])
            tiles.append(covered / covered.mean(axis=(1, 2), keepdims=True))
    return np.stack(tiles)


def has_emitters(panel: Panel) -> bool:
    """Whether anything is said of where the panel emits."""
    return panel.emitters is not None or all(opening.emitters is not None for opening in panel.openings)


def emitters_of(panel: Panel) -> tuple[Emitters, ...]:
    """The emitters behind each opening of a panel, if they can be shown: the panel's, or else the opening's own.

    Raises:
        JobError: MF121 if there are no emitters, or none of one colour; MF119 if an emitter lies over an opening or off
            the grid of dots.
    """
    return tuple(_checked_emitters(panel, opening) for opening in panel.openings)


def _checked_emitters(panel: Panel, opening: Opening) -> Emitters:
    where = f"opening {opening.name}"
    emitters = panel.emitters
    if emitters is None and opening.emitters is not None:
        emitters = Emitters(opening.emitters, panel.cell_size.dots_nm // len(opening.emitters))
    if emitters is None:
        raise JobError(
            "MF121", "the panel has no emitters", where=where, cure="Say in the job where red, green and blue emit"
        )
    labels = emitters.labels
    side = panel.cell_size.dots_nm
    if labels.ndim != 2 or labels.shape[0] != labels.shape[1] or labels.shape[0] * emitters.cell_nm != side:
        raise JobError(
            "MF119",
            f"{labels.shape} cells of {emitters.cell_nm} nm are not the pixel's {side} nm",
            where=where,
            cure="Divide the pixel less its gutter into square cells of whole nanometres",
        )
    if panel.dot_nm % emitters.cell_nm:
        raise JobError(
            "MF119",
            f"cells of {emitters.cell_nm} nm do not divide a dot of {panel.dot_nm} nm",
            where=where,
            cure="Use cells that divide a dot",
        )
    per_dot = panel.dot_nm // emitters.cell_nm
    clear = np.kron(opening.mask, np.ones((per_dot, per_dot), dtype=np.bool_))
    over = int((clear & (labels > 0)).sum())
    if over:
        raise JobError(
            "MF119",
            f"{over} cells of the emitters lie over an opening",
            where=where,
            cure="Move the emitters behind the closed area",
        )
    for number, colour in enumerate(COLOURS, start=1):
        if not (labels == number).any():
            raise JobError("MF121", f"no part of a pixel emits {colour}", where=where, cure=f"Give {colour} an emitter")
    return emitters


def _checked(image: Floats) -> tuple[int, int]:
    """Rows and columns of an image that can be shown."""
    if image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
        raise JobError(
            "MF121", f"an array of shape {image.shape} is not a picture", cure="Give [rows, columns, 3], not empty"
        )
    if not np.isfinite(image).all() or image.min() < 0 or image.max() > 1:
        raise JobError("MF121", "a picture's light is not within 0 to 1", cure="Scale the picture to 0 to 1")
    return image.shape[0], image.shape[1]


def _check_samples(rows: int, columns: int, samples: int) -> None:
    if samples < 1:
        raise JobError("MF121", f"{samples} samples per pixel", where="samples", cure="Use 1 or more; 21 is usual")
    if rows * columns * samples**2 > MOST_SAMPLES:
        raise JobError(
            "MF115",
            f"{columns} x {rows} pixels of {samples} x {samples} samples are more than {MOST_SAMPLES}",
            where="pixels, samples",
            cure=f"Show fewer pixels, or use {max(1, int((MOST_SAMPLES / (rows * columns)) ** 0.5))} samples",
        )


def _still(array: Floats) -> Floats:
    array.flags.writeable = False  # or Light would copy it
    return array
