r"""Photographs whose blur changes over the field: seen through a gap, every image point has openings of its own.

The openings that two places have in common lie elsewhere in the stop, which leaves the point spread as it is; it
changes by those that the stop's rim shows to one of them alone. That is little, and smooth in place:

    light = H scene + Σ_k V_k (a_k scene),

with H of the axis, V_k the principal components of the changes at nodes, and a_k bilinear between these (Lauer, SPIE
4847, 167, 2002). Changes keep within some pixels, so each takes one small transform of a part of the scene. As many
nodes and components are taken as the accuracy of the plan asks for; the error that is left is measured at the nodes
and at places half-way between some, with their own point spreads.

Notes:
    What diffraction over the gap changes is mostly so little that it may be as on the axis everywhere; where it is
    more than half of the accuracy, it is taken at every node, which takes longer.
    A phase takes transforms for every line, so that nodes are few.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
import scipy
from numpy.typing import NDArray

from maskfab.base.arrays import Floats, Singles
from maskfab.camera.die_transfer import DieTransfer, Lines, Samples, StopView
from maskfab.camera.imaging import Margin, Transfer
from maskfab.optics.gap import AXIS, Place
from maskfab.optics.pupil import Aperture
from maskfab.optics.scene.plan import Plan
from maskfab.optics.spectrum import Spectrum

COUNTS, PHASED_COUNTS = (1, 3, 5, 9), (1, 3, 5)
"""Nodes along each axis of a picture: one grid within the next."""
MOST_LINES = 16
"""Of a band, for changes."""
REACH = 127
"""Pixels by which a change of the point spread reaches out, along each axis."""
MOST_ACROSS = 1024
"""Pixels along a side of the part of a sensor that is transformed at once."""

# Share of the accuracy that components may leave out at any node.
_LEFT_OUT = 0.5


@dataclass(frozen=True, eq=False)
class FieldNodes:
    """Places of a picture at which the point spread is computed.

    Attributes:
        y_um, x_um: from the axis, which is the picture's middle, down and to the right; ascending, one or more.
    """

    y_um: Floats
    x_um: Floats
    shape: tuple[int, int]
    pixel_um: float

    @classmethod
    def of(cls, view: StopView, shape: tuple[int, int], count: int) -> FieldNodes:
        """So many along each axis, over picture and field; beyond the field the outermost stand for all."""
        pixel = view.camera.pixel_um
        # The corners of the nodes' square lie within the field.
        widest = view.scene.field_um / math.sqrt(2)
        y, x = (np.linspace(-1, 1, count) if count > 1 else np.zeros(1) for _ in shape)
        up, across = (min(widest, (pixels - 1) / 2 * pixel) for pixels in shape)
        return cls(up * y, across * x, shape, pixel)

    @property
    def places(self) -> list[Place]:
        """Places of all nodes, (x, y), those of a row side by side."""
        return [(float(x), float(y)) for y, x in product(self.y_um, self.x_um)]

    def corners(self, inwards: int) -> list[Place]:
        """Four places: those of the corners, or so many rows and columns within."""
        ends = inwards, -1 - inwards
        return [(float(self.x_um[i]), float(self.y_um[j])) for j, i in product(ends, ends)]

    def weights(self) -> tuple[Singles, Singles]:
        """Weights of every row in every node along y, [nodes, rows], and of every column; each sums to 1 over nodes."""
        up, across = (
            _hats(nodes, (np.arange(count, dtype=np.float64) - (count - 1) / 2) * self.pixel_um)
            for nodes, count in zip((self.y_um, self.x_um), self.shape, strict=True)
        )
        return up, across

    def shares(self, place: Place) -> Floats:
        """Weights of a place in all nodes."""
        x, y = place
        return np.outer(_hats(self.y_um, np.array([y])), _hats(self.x_um, np.array([x]))).ravel().astype(np.float64)


@dataclass(frozen=True, eq=False)
class FieldChange:
    """The change of a die's point spread over a picture, against that of the axis.

    Attributes:
        spreads: V_k, float32 [components, 3, n, n] with n = 2 REACH + 1, no displacement first; their sum is 0.
        shares: a_k at the nodes, float32 [components, nodes y, nodes x].
        error: relative L2 error of the point spread, the largest measured.
    """

    nodes: FieldNodes
    spreads: Singles
    shares: Singles
    error: float
    _kept: dict[tuple[int, ...], NDArray[np.complex64]] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def of(cls, transfer: DieTransfer, plan: Plan, shape: tuple[int, int]) -> FieldChange:
        """Of a die on pictures of a shape, with the fewest nodes and components that the plan's accuracy allows."""
        view = transfer.view
        places = _Places.of(transfer, plan.accuracy, FieldNodes.of(view, shape, 3).places[-1])
        for count in PHASED_COUNTS if places.phased else COUNTS:
            nodes = FieldNodes.of(view, shape, count)
            spreads, shares = _components(np.stack([places.change(p) for p in nodes.places]), _LEFT_OUT * plan.accuracy)
            finer = FieldNodes.of(view, shape, max(3, 2 * count - 1))
            error = max(
                float(np.linalg.norm((nodes.shares(place) @ shares) @ spreads - places.change(place)))
                for place in (*nodes.places, *finer.corners(0 if count == 1 else 1))
            )
            if error <= plan.accuracy:
                break
        side = 2 * REACH + 1
        return cls(
            nodes,
            (places.scale * spreads).reshape(-1, 3, side, side),
            shares.T.reshape(-1, nodes.y_um.size, nodes.x_um.size).astype(np.float32),
            math.hypot(error, places.left_out),
        )

    def add(self, light: Singles, margin: Margin, seen: Singles) -> None:
        """Add what the change does to the light of a scene as ``seen`` on the sensor, [3, rows, columns]."""
        if not len(self.spreads):
            return
        sides = seen.shape[1:]
        sizes = tuple(_size(count) for count in sides)
        up, across = self.nodes.weights()
        transfers = self._kept.get(sizes)
        if transfers is None:
            transfers = self._transfers(sizes)
            if not margin.large:
                self._kept[sizes] = transfers
        starts = (range(0, count, size - 2 * REACH) for count, size in zip(sides, sizes, strict=True))
        for top, left in product(*starts):
            y, x = (
                (margin.width + first - REACH + np.arange(size)) % count
                for first, size, count in zip((top, left), sizes, margin.shape, strict=True)
            )
            part = light[:, y[:, None], x]
            total = np.zeros_like(transfers[0])
            for transfer, share in zip(transfers, self.shares, strict=True):
                shared = part * (up[:, y].T @ share @ across[:, x])
                spectrum = scipy.fft.rfft2(shared, axes=(1, 2), overwrite_x=True, workers=1)
                spectrum *= transfer
                total += spectrum
            change = scipy.fft.irfft2(total, s=sizes, axes=(1, 2), overwrite_x=True, workers=1)[:, REACH:, REACH:]
            there = seen[:, top : top + sizes[0] - 2 * REACH, left : left + sizes[1] - 2 * REACH]
            there += change[:, : there.shape[1], : there.shape[2]]

    def _transfers(self, sizes: tuple[int, ...]) -> NDArray[np.complex64]:
        """Transfers of every component, at the frequencies of ``rfft2`` of parts of that size, [components, 3, ...]."""
        transfers = np.empty((*self.spreads.shape[:2], sizes[0], sizes[1] // 2 + 1), dtype=np.complex64)
        place = np.arange(-REACH, REACH + 1)
        for spread, transfer in zip(self.spreads, transfers, strict=True):
            wide = np.zeros((3, *sizes), dtype=np.float32)
            wide[:, place[:, None], place] = spread[:, place[:, None], place]
            transfer[:] = scipy.fft.rfft2(wide, axes=(1, 2), workers=1)
        return transfers


@dataclass(frozen=True, eq=False)
class OverField:
    """A die whose point spread changes over the field; a camera that knows only that of the axis restores by it."""

    transfer: DieTransfer
    plan: Plan
    _kept: dict[tuple[int, int], FieldChange] = field(default_factory=dict, init=False, repr=False)

    def through(self, openings: Aperture, finer: int) -> OverField:
        return OverField(self.transfer.through(openings, finer), self.plan)

    @property
    def name(self) -> str:
        return self.transfer.name

    @property
    def transmission(self) -> float:
        return self.transfer.transmission

    def on(self, shape: tuple[int, int]) -> Transfer:
        """H on the axis, as of :class:`maskfab.camera.die_transfer.DieTransfer`."""
        return self.transfer.on(shape)

    @property
    def told(self) -> tuple[str, ...]:
        sizes: dict[str, list[str]] = {}
        for (rows, columns), change in self._kept.items():
            count = change.nodes.y_um.size
            places = "that of the axis" if count == 1 else f"of {count} x {count} places and linear in between"
            sentence = (
                f"over the field the point spread is {places}: it errs by {change.error:.1g} of its norm at most where "
                f"that was measured, and the accuracy asked for is {self.plan.accuracy:g}"
            )
            sizes.setdefault(sentence, []).append(f"{columns} x {rows}")
        if len(sizes) == 1:
            return tuple(sizes)
        return tuple(f"in scenes of {', '.join(alike)} pixels {sentence}" for sentence, alike in sizes.items())

    def change(self, shape: tuple[int, int]) -> FieldChange:
        """Over pictures of that shape; kept for the scenes that follow."""
        if shape not in self._kept:
            self._kept[shape] = FieldChange.of(self.transfer, self.plan, shape)
        return self._kept[shape]

    def blurred(self, light: Singles, margin: Margin) -> Singles:
        seen = self.transfer.blurred(light, margin)
        self.change(margin.shape).add(light, margin, seen)
        return seen


@dataclass(frozen=True, eq=False)
class _Places:
    """Changes of the point spread from the axis to places of the image."""

    view: StopView
    samples: Samples
    lines: tuple[Lines, ...]
    axis: Singles
    scale: np.float32
    left_out: float
    _kept: dict[Place, Singles] = field(default_factory=dict, init=False, repr=False)
    """Kept, for one grid of nodes lies within the next."""

    @classmethod
    def of(cls, transfer: DieTransfer, accuracy: float, corner: Place) -> _Places:
        """With diffraction over the gap if its change to the corner takes more than half of the accuracy."""
        view, samples = transfer.view, transfer.samples
        lines = tuple(replace(line, shadow=gathered(line.shadow, MOST_LINES)) for line in transfer.lines)
        plain, left_out = view.without_gap(), 0.0
        if view.choice.diffraction:
            green = lines[1:2]
            near, far = (
                _spread(place, samples, green) - _spread(place.without_gap(), samples, green)
                for place in (view, view.at(corner))
            )
            left_out = float(np.linalg.norm(far - near) / np.linalg.norm(_spread(plain, samples, green)))
            if left_out > _LEFT_OUT * accuracy:
                plain, left_out = view, 0.0
        axis = _spread(plain, samples, lines)
        return cls(plain, samples, lines, axis, np.float32(np.linalg.norm(axis)), left_out)

    @property
    def phased(self) -> bool:
        return any(self.view.has_phase(line.shadow.centroid_nm) for line in self.lines)

    def change(self, place: Place) -> Singles:
        """To one place, [3 n n], relative to the norm of the axis's."""
        if place == AXIS:
            return np.zeros_like(self.axis)
        if place not in self._kept:
            there = _spread(self.view.at(place), self.samples, self.lines)
            self._kept[place] = (there - self.axis) / self.scale
        return self._kept[place]


def _spread(view: StopView, samples: Samples, lines: tuple[Lines, ...]) -> Singles:
    """Point spread of each colour at a place, on as many pixels as changes reach, [colours n n]."""
    side = 2 * REACH + 1
    # Half of the frequencies tell the others. To have half of the rows takes the least work.
    y, x = np.asarray(scipy.fft.rfftfreq(side)), np.asarray(scipy.fft.fftfreq(side))
    transfers = np.stack([view.transfer(line, samples, y, x) for line in lines])
    return np.asarray(scipy.fft.irfft2(transfers, s=(side, side), axes=(2, 1), workers=1), dtype=np.float32).ravel()


def _components(changes: Singles, most: float) -> tuple[Singles, Floats]:
    """Fewest principal components [k, n] that leave out ``most`` of any change [places, n], and shares [places, k]."""
    # Few places, long changes: the products of these tell all.
    values, vectors = np.linalg.eigh((changes @ changes.T).astype(np.float64))
    values, vectors = values[::-1], vectors[:, ::-1]
    explained = np.cumsum(vectors**2 * values, axis=1)
    missing = np.sqrt(np.maximum(explained[:, -1:] - explained, 0)).max(axis=0)
    whole = math.sqrt(max(float(explained[:, -1].max()), 0.0))
    count = 0 if whole <= most else int(np.argmax(missing <= most)) + 1
    chosen = vectors[:, :count]
    return (chosen.T.astype(np.float32) @ changes), chosen


def _size(count: int) -> int:
    """Side of parts into which so many pixels go evenly, with what reaches in from beyond them."""
    parts = math.ceil(count / MOST_ACROSS)
    return int(scipy.fft.next_fast_len(math.ceil(count / parts) + 2 * REACH, real=True))


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
