"""Views of a scene: the pictures of single points over the field, the depth and the colours."""

from __future__ import annotations

import math
from dataclasses import dataclass

from maskfab.base.arrays import Floats
from maskfab.model import Die, Psf, Quantity, frozen
from maskfab.optics.scene.plan import Plan
from maskfab.optics.scene.scene import Scene
from maskfab.optics.wavefront.panel_gap import Place
from maskfab.units import UM_PER_MM


@dataclass(frozen=True, eq=False)
class PointView:
    """The picture of one point of the scene.

    Attributes:
        image_um: where it lies on the sensor.
        object_um: how far the object is from the lens; may be infinite.
        psf: on pixels.
        change: relative L2 distance of ``psf`` from that of the axis in focus.
        left: float64 [n, n], the PSF after Wiener deblurring with that of the axis in focus, on pixels.
        residual: relative L2 distance of ``left`` from what deblurring leaves of the axis in focus itself.
    """

    image_um: Place
    object_um: float
    psf: Psf
    change: float
    left: Floats
    residual: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "left", frozen(self.left))


@dataclass(frozen=True, eq=False)
class SceneOptics:
    """Optics of a scene behind one die.

    Attributes:
        die: the design.
        scene: what is looked at.
        plan: how it was modelled.
        field: views of objects in focus, [y][x] over the field; none where the plan gives every place one PSF.
        depth: views on the axis, nearest first; none where the plan gives every distance one PSF.
        colours: PSF on pixels of each band, on the axis in focus; none for lines.
        quantities: what is told of all this.
    """

    die: Die
    scene: Scene
    plan: Plan
    field: tuple[tuple[PointView, ...], ...]
    depth: tuple[PointView, ...]
    colours: tuple[Psf, ...]
    quantities: tuple[Quantity, ...]


def distance(length_um: float) -> str:
    """A distance in the unit that a reader would choose."""
    if math.isinf(length_um):
        return "infinity"
    return f"{length_um / 1e6:.4g} m" if length_um >= 1e5 else f"{length_um / UM_PER_MM:.4g} mm"
