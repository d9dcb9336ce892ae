r"""Photographs whose blur changes over the field: seen through a gap, every image point has openings of its own.

Every point of a scene is shared among the nodes round it, by bilinear weights w, and spreads as they do:

    light = Σ_n H_n (w_n scene),    Σ_n w_n = 1,

so that no light is lost. Between nodes the point spread is a mixture of theirs. That errs by more than a band of 16
lines does, so no node takes more of them; the transfer by which a picture is restored has as many as it needs.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from maskfab.camera.design import SceneLight
from maskfab.camera.die_transfer import DieTransfer
from maskfab.camera.restorers.restorer import Transfer
from maskfab.camera.restorers.wiener import Margin
from maskfab.optics.image.spectrum import Spectrum
from maskfab.optics.scene.plan import Plan
from maskfab.optics.wavefront.panel_gap import Place

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

MOST_NODES = 5
"""Along each axis of a picture: every node is a transfer, and a transform of the scene."""
MOST_LINES = 16
"""Of a band, at a node."""


@dataclass(frozen=True, eq=False)
class FieldNodes:
    """Places of a picture at which the transfer is computed.

    Attributes:
        y_um, x_um: from the axis, which is the picture's middle, down and to the right; ascending, one or more.
        shape: rows and columns of the picture.
        pixel_um: side of its pixels.
    """

    y_um: Floats
    x_um: Floats
    shape: tuple[int, int]
    pixel_um: float

    @classmethod
    def of(cls, transfer: DieTransfer, plan: Plan, shape: tuple[int, int]) -> FieldNodes:
        """As close together as a plan's places, but five along an axis at most; the axis alone where it needs no more.

        Beyond the scene's field the outermost nodes stand for all.
        """
        scene, pixel = transfer.view.scene, transfer.view.camera.pixel_um
        places = plan.choice.places
        if places == 1:
            return cls(np.zeros(1), np.zeros(1), shape, pixel)
        spacing = 2 * scene.field_um / (places - 1)
        # The corners of the nodes' square lie within the field.
        widest = scene.field_um / math.sqrt(2)

        def along(pixels: int) -> Floats:
            reach = min(widest, (pixels - 1) / 2 * pixel)
            count = min(MOST_NODES, 2 * math.ceil(reach / spacing) + 1)
            return np.linspace(-reach, reach, count)

        return cls(along(shape[0]), along(shape[1]), shape, pixel)

    def weights(self) -> tuple[Singles, Singles]:
        """Of every row in every node along y, [nodes, rows], and of every column; each sums to 1 over nodes."""
        up, across = (
            _hats(nodes, (np.arange(count, dtype=np.float64) - (count - 1) / 2) * self.pixel_um)
            for nodes, count in zip((self.y_um, self.x_um), self.shape, strict=True)
        )
        return up, across

    def error(self, transfer: DieTransfer) -> float:
        """Largest error of H at some frequencies, half-way between the nodes nearest to the axis; 0 for one."""
        near = [nodes[abs(nodes).argsort(kind="stable")[:2]] for nodes in (self.y_um, self.x_um)]
        if all(each.size == 1 for each in near):
            return 0.0
        between = transfer.at((float(near[1].mean()), float(near[0].mean()))).probe
        nodes = [transfer.at((float(x), float(y))).probe for y, x in product(*near)]
        mixed = sum(nodes[1:], start=nodes[0]) / np.float32(len(nodes))
        return float(abs(between - mixed).max())


@dataclass(frozen=True, eq=False)
class OverField:
    """A die whose point spread changes over the field; a camera that knows only that of the axis restores by it.

    Attributes:
        transfer: of the die, on the axis.
        plan: that says how close together places are.
    """

    transfer: DieTransfer
    plan: Plan
    _kept: dict[Place, DieTransfer] = field(default_factory=dict, init=False, repr=False)

    @property
    def name(self) -> str:
        """Of the die."""
        return self.transfer.name

    @property
    def transmission(self) -> float:
        """Share of the stop's light that passes on the axis."""
        return self.transfer.transmission

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H on the axis, as of :class:`maskfab.camera.die_transfer.DieTransfer`."""
        return self.transfer.on(shape)

    def blurred(self, light: SceneLight) -> Singles:
        """See :class:`maskfab.camera.design.Design`.

        Raises:
            JobError: MF114 if the die does not cover the stop from a place of the field.
        """
        nodes = FieldNodes.of(self.transfer, self.plan, light.margin.shape)
        return blurred_over_field(light.values, self._at, nodes, light.margin)

    def _at(self, image_um: Place) -> DieTransfer:
        """The transfer at a place, kept for the scenes that follow."""
        if image_um not in self._kept:
            known = self.transfer.resolution
            lines = tuple(replace(each, shadow=gathered(each.shadow, MOST_LINES)) for each in known.lines)
            self._kept[image_um] = replace(self.transfer.at(image_um), resolution=replace(known, lines=lines))
        return self._kept[image_um]


def blurred_over_field(
    scene: Singles, transfer: Callable[[Place], DieTransfer], nodes: FieldNodes, margin: Margin
) -> Singles:
    """Light on the sensor, as :meth:`maskfab.camera.restore.Margin.blurred` of one transfer gives it.

    Args:
        scene: float32 [3, rows, columns].
        transfer: of the die at a place of the image.
        nodes: of the scene's shape.
        margin: of the scene.

    Raises:
        JobError: MF114 if the die does not cover the stop from a node.
    """
    up, across = nodes.weights()
    total = np.zeros_like(margin.sensor(scene))
    for (j, y), (i, x) in product(enumerate(nodes.y_um), enumerate(nodes.x_um)):
        shared = scene * (up[j][:, None] * across[i])
        spectrum = scipy.fft.rfft2(shared, axes=(1, 2), workers=1, overwrite_x=True)
        total += margin.blurred(spectrum, transfer((float(x), float(y))).on(nodes.shape))
    return total


def gathered(spectrum: Spectrum, most: int) -> Spectrum:
    """The spectrum with neighbouring lines as one at their mean, so many lines at most."""
    count = spectrum.wavelengths_nm.size
    if count <= most:
        return spectrum
    starts = np.arange(most) * count // most
    weights = np.add.reduceat(spectrum.weights, starts)
    means = np.add.reduceat(spectrum.weights * spectrum.wavelengths_nm, starts)
    lit = weights > 0
    return Spectrum(means[lit] / weights[lit], weights[lit], spectrum.name)


def _hats(nodes: Floats, places: Floats) -> Singles:
    """Linear weights of places in nodes, [nodes, places]; beyond the last it has all."""
    return np.array([np.interp(places, nodes, row) for row in np.eye(nodes.size)], dtype=np.float32)
