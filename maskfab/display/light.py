r"""Cost of an emitter's area: current density, and the life that goes with it.

    J_k = L s_k / (η_k a_k),   life ~ J^-n,

L the luminance of white, s_k the colour's share of it, η_k its efficacy and a_k its area as a share of the pixel.

Notes:
    Regimes: efficacy that does not fall with current, no loss in a polariser (divide η by its transmission), one
    ageing exponent for all colours. Extrapolated lives can be wrong by a factor of three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from maskfab.errors import JobError
from maskfab.optics.numbers.colour import LUMINANCE

Triple = tuple[float, float, float]

SHARES: Triple = (float(LUMINANCE[0]), float(LUMINANCE[1]), float(LUMINANCE[2]))
"""Luminance of the primaries in white."""

MA_PER_CM2 = 0.1
"""1 A/m² in mA/cm²."""


@dataclass(frozen=True)
class LightDemand:
    """Light required of the emitters, and their efficacies.

    Attributes:
        luminance_cd_per_m2: of white. 500 is a judgement: a phone indoors.
        efficacy_cd_per_a: red, green and blue. 45, 110 and 8 are a judgement; no source was found.
        shares: red's, green's and blue's share of the luminance, by BT.709.
        ageing_exponent: n of life ~ J^-n. 1.44 is derived from a vendor's claim: three times the life at 60 % emitting
            area instead of 28 %, ln 3 / ln (60 / 28).

    Raises:
        JobError: MF104 if a number is not positive and finite.
    """

    luminance_cd_per_m2: float = 500.0
    efficacy_cd_per_a: Triple = (45.0, 110.0, 8.0)
    shares: Triple = SHARES
    ageing_exponent: float = 1.44

    def __post_init__(self) -> None:
        _check("luminance", (self.luminance_cd_per_m2,))
        _check("efficacy", self.efficacy_cd_per_a)
        _check("shares", self.shares)
        _check("ageing_exponent", (self.ageing_exponent,))


def current_density(light: LightDemand, area_shares: Triple) -> Triple:
    """Current density of red, green and blue at white, in mA/cm².

    Args:
        light: what is asked.
        area_shares: each emitter's area over the pixel's, gutter included.

    Raises:
        JobError: MF104 if a share is not within (0, 1].
    """
    _check("area share", area_shares, highest=1.0)
    red, green, blue = (
        MA_PER_CM2 * light.luminance_cd_per_m2 * share / (efficacy * area)
        for share, efficacy, area in zip(light.shares, light.efficacy_cd_per_a, area_shares, strict=True)
    )
    return red, green, blue


def relative_life(density: float, reference: float, exponent: float = LightDemand.ageing_exponent) -> float:
    """Life at a current density over that at another: (J / J_ref)^-n.

    Raises:
        JobError: MF104 if a number is not positive and finite.
    """
    _check("current density", (density, reference))
    _check("ageing_exponent", (exponent,))
    return float((density / reference) ** -exponent)


def _check(name: str, values: tuple[float, ...], highest: float = math.inf) -> None:
    for value in values:
        if not (math.isfinite(value) and 0 < value <= highest):
            limit = "positive and finite" if highest == math.inf else f"above 0 and at most {highest:g}"
            raise JobError(
                "MF104", f"{name} = {value:g} is not {limit}", where="light", cure=f"Give {name} as a number {limit}"
            )
