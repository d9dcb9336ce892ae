"""The plate as it is made, which the optics take as a job states it: chrome and glass of the blank, and what the mask
writer does to shapes."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from maskfab.base import checks as require
from maskfab.base.errors import JobError
from maskfab.job.values import Length, LengthOrZero, SignedLength, Stated


@dataclass(frozen=True)
class Glass(Stated):
    """plate.glass: substrate of the plate."""

    thickness_um: Length
    """Thickness of the plate."""
    index: Annotated[float, Field(ge=1, le=4, allow_inf_nan=False)]
    """Refractive index of the plate."""
    chrome: Literal["lens", "away"]
    """Side of the glass that carries the chrome: towards the lens, or away from it."""

    def __post_init__(self) -> None:
        require.number(self, "thickness_um")
        require.number(self, "index", 1.0, open_low=False)
        require.choice(self, "chrome", ("lens", "away"))

    @property
    def gap_um(self) -> float:
        """The air over which light spreads as much as from the chrome through the glass: t/n, 0 on the lens's side."""
        return self.thickness_um / self.index if self.chrome == "away" else 0.0


@dataclass(frozen=True)
class MaskBlank(Stated):
    """Chrome and glass of [plate]; what is left out is part of the model bar instead of the model."""

    optical_density: Annotated[float, Field(gt=0, le=12, allow_inf_nan=False)] | None = None
    """Optical density of the chrome; without it the leak is part of the model bar."""
    film_phase_waves: Annotated[float, Field(ge=-1, le=1, allow_inf_nan=False)] | None = None
    """Phase lag, in waves, of light that leaks through the chrome, equal at every line; without it the worst."""
    glass: Glass | None = None
    """Substrate, a table; without it the model bar assumes 90 mil of silica, chrome away from the lens."""

    def __post_init__(self) -> None:
        if self.film_phase_waves is not None and self.optical_density is None:
            what = "film_phase is given without optical_density"
            raise JobError("MF105", what, cure="Add optical_density, such as 3, or remove film_phase")

    @property
    def mask_blank(self) -> MaskBlank:
        """The blank alone, of a section that states more."""
        return MaskBlank(self.optical_density, self.film_phase_waves, self.glass)


UNSTATED = MaskBlank()
"""A plate of which a job says nothing."""


@dataclass(frozen=True)
class Roughness(Stated):
    """[process.roughness]: written edges that are not straight; what they scatter is part of PSF and MTF as written."""

    sigma_um: LengthOrZero
    """Root mean square of their displacements along the normal; a third of what is called 3σ line edge roughness."""
    correlation_um: Length
    """Distance along an edge at which the correlation of displacements, exp(-(s / correlation)²), is 1/e."""

    def __post_init__(self) -> None:
        require.number(self, "sigma_um", open_low=False)
        require.number(self, "correlation_um")


@dataclass(frozen=True)
class Process(Stated):
    """Corners, widths and edges as the mask writer makes them."""

    corner_radius_um: LengthOrZero = 0.0
    """Radius to which the writer rounds corners."""
    cd_bias_um: SignedLength = 0.0
    """Change of width of a clear line; positive widens what is clear."""
    roughness: Roughness | None = None

    def __post_init__(self) -> None:
        require.number(self, "corner_radius_um", open_low=False)
        require.number(self, "cd_bias_um", -sys.float_info.max, open_low=False)
