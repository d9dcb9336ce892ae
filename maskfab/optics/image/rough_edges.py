r"""The PSF of openings whose edges are rough: what is left of the orders, and the halo that they feed.

An edge is displaced along its normal by ξ(s), normally distributed with the root mean square σ and the correlation
ρ(s) = exp(-(s / l)²). The mean field is that of the smooth openings times exp(-(2π f σ)² / 2), the Debye-Waller
factor, and the light that the orders lose is spread about them: an edge of length L adds

    L ∫ ds exp(-2πi f_t s) (exp(-a (1 - ρ)) - exp(-a)) / (2π f_n)²,    a = (2π f_n σ)²,

to the squared field at the frequency f = (f_n, f_t) across and along it (P. Beckmann, A. Spizzichino, The Scattering of
Electromagnetic Waves from Rough Surfaces, 1963, ch. 5, of one dimension less). Over all frequencies it holds L σ / √π,
and the mean field so much less: light is conserved, and the open ratio is that of the smooth openings in the mean.

Notes:
    The factor is exact for shapes of right angles whose edges are independent of each other, where it is one factor
    across and one up; of arcs it is as far as σ is small beside their radius. Near the ends of edges of length L the
    halo is wrong by about l / (√π L) of itself.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from maskfab.base.arrays import Floats
from maskfab.model import Psf, Roughness, frozen

_LEAST_TERM = 1e-12


@dataclass(frozen=True, eq=False)
class EdgeLengths:
    """Edges of clear shapes by their direction.

    Attributes:
        along: float64 [n, 2] unit vectors along the edges.
        length_um: float64 [n] of all edges of a direction together.
    """

    along: Floats
    length_um: Floats

    @classmethod
    def of(cls, edges_um: Floats, counts: Floats) -> EdgeLengths:
        """Of edges x0, y0, x1, y1 [n, 4], each so many times; opposite directions are one."""
        vectors = edges_um[:, 2:] - edges_um[:, :2]
        lengths = np.hypot(*vectors.T)
        back = (vectors[:, 1] < 0) | ((vectors[:, 1] == 0) & (vectors[:, 0] < 0))
        units = np.where(back[:, None], -vectors, vectors) / lengths[:, None]
        along, index = np.unique(np.round(units, 9) + 0.0, axis=0, return_inverse=True)
        summed = np.zeros(len(along))
        np.add.at(summed, index.ravel(), lengths * counts)
        return cls(frozen(along), frozen(summed))

    @property
    def total_um(self) -> float:
        """Length of all edges."""
        return float(self.length_um.sum())


def scattered_um2(edges: EdgeLengths, roughness: Roughness) -> float:
    """Clear area whose light leaves the orders of smooth edges for the halo, wherever it goes."""
    return edges.total_um * roughness.sigma_um / float(np.sqrt(np.pi))


def halo_um3(across: Floats, along: Floats, roughness: Roughness) -> Floats:
    """Mean squared field that a micrometre of rough edge adds.

    Args:
        across, along: cycles per micrometre across the edge and along it.
        roughness: of the edge.
    """
    a = (2 * np.pi * across * roughness.sigma_um) ** 2
    decay = (np.pi * along * roughness.correlation_um) ** 2
    found = np.zeros(np.broadcast(a, decay).shape)
    power, k = np.exp(-a), 1
    while True:
        found += power / np.sqrt(k) * np.exp(-decay / k)
        k += 1
        power = power * a / k
        if k > a.max(initial=0.0) and power.max(initial=0.0) < _LEAST_TERM:
            break
    scale = roughness.sigma_um**2 * roughness.correlation_um * np.sqrt(np.pi)
    return np.asarray(scale * found)


def rough_psf(smooth: Psf, edges: EdgeLengths, area_um2: float, scale_um2: float, roughness: Roughness) -> Psf:
    """The PSF of openings with rough edges, in the mean over all displays.

    Args:
        smooth: that of smooth edges, at points.
        edges: all of them inside the stop, without the stop's own.
        area_um2: what is clear in the stop.
        scale_um2: wavelength times image distance: micrometres on the sensor for a cycle per micrometre.
        roughness: of the edges.
    """
    half = smooth.values.shape[0] // 2
    f = smooth.step_um / scale_um2 * np.arange(-half, half + 1, dtype=np.float64)
    fx, fy = f[None, :], f[:, None]
    values = smooth.values * np.exp(-((2 * np.pi * roughness.sigma_um) ** 2) * (fx**2 + fy**2))
    for (tx, ty), length in zip(edges.along, edges.length_um, strict=True):
        halo = halo_um3(fx * ty - fy * tx, fx * tx + fy * ty, roughness)
        values = values + length / (scale_um2**2 * area_um2) * halo
    return replace(smooth, values=values)
