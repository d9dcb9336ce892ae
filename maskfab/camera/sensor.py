r"""A sensor: full well, read noise, converter and mosaic, and a picture as it records it.

    y = min(Poisson(g · light) + σ N, full well) / g

with g the electrons of white, σ the read noise and N normal; a converter then rounds to its codes. Under a mosaic each
pixel records one colour, and the two that it lacks are interpolated from its neighbours, which correlates the noise
that a restorer takes for white.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from maskfab.camera.mosaic import interpolated, sampled
from maskfab.camera.record import Noise, Record
from maskfab.errors import JobError

Mosaic = Literal["none", "rggb"]


@dataclass(frozen=True)
class Sensor:
    """A sensor; the defaults are those of protocol F1.

    Attributes:
        full_well: most electrons of a pixel.
        read_noise: standard deviation, in electrons.
        bits: of the converter, whose largest code is a full well; None to leave out rounding.
        black_level: code of no light.
        mosaic: every pixel records all colours, or one of red, green, green and blue.

    Raises:
        JobError: MF140 for numbers that no sensor has.
    """

    full_well: float = 15506.0
    read_noise: float = 4.87
    bits: int | None = None
    black_level: int = 0
    mosaic: Mosaic = "none"

    def __post_init__(self) -> None:
        if not (np.isfinite(self.full_well) and self.full_well > 0):
            raise _refused(f"a full well of {self.full_well:g} electrons", "full_well", "Give 1 electron or more")
        if not (np.isfinite(self.read_noise) and 0 <= self.read_noise < self.full_well):
            raise _refused(
                f"a read noise of {self.read_noise:g} electrons with a full well of {self.full_well:g}",
                "read_noise",
                "Give 0 or more, below the full well",
            )
        if self.bits is None:
            if self.black_level:
                raise _refused(
                    f"a black level of {self.black_level} codes without bits",
                    "black_level",
                    "Add the bits of the converter, or remove the black level",
                )
        elif not 1 <= self.bits <= 32 or not 0 <= self.black_level < 2**self.bits - 1:
            raise _refused(
                f"a black level of {self.black_level} with {self.bits} bits",
                "black_level",
                "Give 1 to 32 bits, and a black level below their largest code",
            )

    @property
    def step(self) -> float:
        """Electrons of one code; 0 without a converter."""
        return 0.0 if self.bits is None else self.full_well / (2**self.bits - 1 - self.black_level)

    def record(self, light: NDArray[np.float32], electrons: float, seed: int, *, smooth: bool = False) -> Record:
        """Record light in units of white.

        Args:
            light: on the pixels, [3, rows, columns], white is 1; what a transform left below 0 is dark.
            electrons: of white, g.
            seed: of ``numpy.random.default_rng``; the same seed gives the same record.
            smooth: count electrons by a normal distribution of Poisson's mean and variance. A little more light then
                gives the same noise a little larger; Poisson's draws would be others from the first pixel that counts
                one more.

        Raises:
            JobError: MF104 for electrons that are not positive and finite; MF140 for a mosaic on odd sides.
        """
        if not (np.isfinite(electrons) and electrons > 0):
            raise JobError(
                "MF104", f"{electrons:g} electrons of white are not above 0", cure="Give the scene more light"
            )
        draw = np.random.default_rng(seed)
        seen = light if self.mosaic == "none" else sampled(light)
        counted = np.empty(seen.shape, dtype=np.float32)
        # Row by row in the same order as all at once, which takes eight bytes a pixel.
        for lines in np.ndindex(seen.shape[:-1]):
            mean = np.maximum(seen[lines], 0) * electrons
            counted[lines] = mean + np.sqrt(mean) * draw.standard_normal(mean.size) if smooth else draw.poisson(mean)
        for lines in np.ndindex(seen.shape[:-1]):
            counted[lines] += np.float32(self.read_noise) * draw.standard_normal(seen.shape[-1], dtype=np.float32)
        full = np.float32(self.full_well)
        np.minimum(counted, full, out=counted)
        if self.bits is not None:
            step, codes = np.float32(self.step), 2**self.bits - 1 - self.black_level
            np.clip(np.rint(counted / step), -self.black_level, codes, out=counted)
            counted *= step
            full = np.float32(codes) * step
        counted /= np.float32(electrons)
        values = counted if self.mosaic == "none" else interpolated(counted)
        ceiling = float(
            full / np.float32(electrons)
        )  # as it was rounded for the pixels, or none would be found clipped
        return Record(values, Noise(electrons, self.read_noise, self.step), ceiling, self.mosaic != "none")


def _refused(what: str, key: str, cure: str) -> JobError:
    return JobError("MF140", f"{what} is no sensor", where=f"sensor.{key}", cure=cure)
