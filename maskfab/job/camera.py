"""The camera of a job, which the optics take as it is: lens, stop, lines and sensor.

    y = min(Poisson(L · light) + σ N, full well / g) / L,        σ² = σ₁² + (σ₂ / g)²

is the picture that a sensor records, with L the electrons of white, g the analog gain over base gain and N normal. σ₁
is the noise before the amplifier and σ₂ that after it, in electrons at base gain. Divided by the gain it counts less
the more is amplified (S. W. Hasinoff, F. Durand, W. T. Freeman, Noise-optimal capture for high dynamic range
photography, CVPR 2010, section 3; the noise model of DNG that Android's test suite fits to sensors has the same two
terms, C ISO² + D). A converter then rounds to its codes, the largest of which is a full well at base gain alone.
:mod:`maskfab.camera.sensor` takes pictures by it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, get_args

import numpy as np
from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler
from pydantic_core import CoreSchema, core_schema

from maskfab.base import checks as require
from maskfab.base.errors import JobError
from maskfab.base.units import NM_PER_UM, UM_PER_MM
from maskfab.job.values import Corners, Length, Section, Stated, Wavelength, checks, length_um, um_text

StopShape = Literal["circle", "square", "ellipse", "rectangle", "annulus", "polygon"]
STOP_SHAPES: tuple[StopShape, ...] = get_args(StopShape)


class StopSection(Section):
    """camera.stop: the lens aperture, the optical axis in its middle or, for a polygon, at the corners' origin."""

    shape: StopShape = "circle"
    """Shape of the lens stop."""
    diameter: Length | None = None
    """Diameter of a circle or of an annulus, side of a square; as the others also as a share of camera.focal, such as
    "f/1.8"."""
    inner: Length | None = None
    """Diameter of the dark middle of an annulus."""
    width: Length | None = None
    """Width along x of an ellipse or rectangle."""
    height: Length | None = None
    """Height along y of an ellipse or rectangle."""
    corners: Corners | None = None
    """Corners of a polygon as pairs of x and y, in either sense of rotation; its sides must not cross."""

    @checks
    def _of_its_shape(self) -> None:
        wanted = _STOP_KEYS[self.shape]
        stated = {key for key in type(self).model_fields if key != "shape" and getattr(self, key) is not None}
        missing, spare = [key for key in wanted if key not in stated], sorted(stated.difference(wanted))
        if missing or spare:
            problem = f"lacks {' and '.join(missing)}" if missing else f"has {' and '.join(spare)}, which means nothing"
            cure = f"Give {' and '.join(wanted)}, and nothing else"
            raise JobError("MF105", f"a stop of the shape {self.shape!r} {problem}", cure=cure)
        if self.inner is not None and self.diameter is not None and self.inner >= self.diameter:
            what = f"an annulus of {self.diameter:g} um with a dark middle of {self.inner:g} um passes nothing"
            raise JobError("MF132", what, cure="Give an inner diameter below the outer one")


_STOP_KEYS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "circle": ("diameter",),
        "square": ("diameter",),
        "annulus": ("diameter", "inner"),
        "ellipse": ("width", "height"),
        "rectangle": ("width", "height"),
        "polygon": ("corners",),
    }
)


@dataclass(frozen=True)
class Stop:
    """The lens aperture in the plane of the openings, the optical axis at its origin: the one form of all that
    :class:`StopSection` may state.

    Attributes:
        shape: circles, ellipses and annuli are ``round``; the others have corners.
        diameter_um: side of the smallest square about the axis that holds it.
        size_um: width and height where they may differ; None for a circle, a square and a polygon.
        inner_share: of an annulus, its dark middle's diameter over its own.
        outline_um: corners of a polygon, counter-clockwise.
    """

    stated_as: ClassVar = StopSection

    shape: StopShape
    diameter_um: float
    size_um: tuple[float, float] | None = None
    inner_share: float = 0.0
    outline_um: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        require.choice(self, "shape", STOP_SHAPES)
        require.number(self, "diameter_um", high=math.inf)  # an infinite one lets everything through
        for side in self.size_um or ():
            require.number(self, "size_um", value=side)
        if self.inner_share:
            require.number(self, "inner_share", 0.0, 1.0, open_low=False)
        if (self.shape == "polygon") != bool(self.outline_um) or (self.outline_um and not self.area_um2 > 0):
            what = f"a {self.shape} with {len(self.outline_um)} corners holds no area that they bound"
            require.refuse(
                "MF132", self, "outline_um", what, "Make a polygon by Stop.polygon, of three corners or more"
            )

    @classmethod
    def _of_section(cls, stated: StopSection) -> Stop:
        if stated.corners is not None:
            return cls.polygon(stated.corners)
        if stated.width is not None and stated.height is not None:
            return (cls.ellipse if stated.shape == "ellipse" else cls.rectangle)(stated.width, stated.height)
        assert stated.diameter is not None
        if stated.inner is not None:
            return cls.annulus(stated.diameter, stated.inner)
        return cls(stated.shape, stated.diameter)

    def as_stated(self) -> StopSection:
        """The section that states it."""
        width, height = self.sides_um
        sizes: dict[str, Any] = {
            "diameter": self.diameter_um,
            "inner": self.inner_share * self.diameter_um,
            "width": width,
            "height": height,
            "corners": self.outline_um,
        }
        keys = _STOP_KEYS[self.shape]
        return StopSection.model_construct(shape=self.shape, **{key: sizes[key] for key in keys})

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        section = handler.generate_schema(StopSection)

        def made(value: Any, read: Any) -> Stop:
            if isinstance(value, cls):
                return value
            return cls._of_section(read({"diameter": value} if isinstance(value, str | int | float) else value))

        return core_schema.no_info_wrap_validator_function(
            made,
            section,
            serialization=core_schema.plain_serializer_function_ser_schema(cls.as_stated, return_schema=section),
        )

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"type": "string"}]}

    @classmethod
    def ellipse(cls, width_um: float, height_um: float) -> Stop:
        return cls("ellipse", max(width_um, height_um), (width_um, height_um))

    @classmethod
    def rectangle(cls, width_um: float, height_um: float) -> Stop:
        return cls("rectangle", max(width_um, height_um), (width_um, height_um))

    @classmethod
    def annulus(cls, diameter_um: float, inner_um: float) -> Stop:
        return cls("annulus", diameter_um, None, inner_um / diameter_um)

    @classmethod
    def polygon(cls, corners_um: Sequence[tuple[float, float]]) -> Stop:
        """A stop of straight sides that do not cross, its corners in either sense of rotation."""
        outline = tuple((float(x), float(y)) for x, y in corners_um)
        turned = outline if _signed_area(outline) > 0 else outline[::-1]
        return cls("polygon", 2 * max(abs(c) for corner in outline for c in corner), outline_um=turned)

    @property
    def round(self) -> bool:
        """Whether its edge is made of ellipses about the axis."""
        return self.shape in ("circle", "ellipse", "annulus")

    @property
    def sides_um(self) -> tuple[float, float]:
        """Width and height of a box about the axis that holds it."""
        return self.size_um or (self.diameter_um, self.diameter_um)

    @property
    def corners_um(self) -> tuple[tuple[float, float], ...]:
        """Corners counter-clockwise; none of a round stop."""
        if self.round or self.outline_um:
            return self.outline_um
        x, y = (side / 2 for side in self.sides_um)
        return (-x, -y), (x, -y), (x, y), (-x, y)

    @property
    def area_um2(self) -> float:
        if self.outline_um:
            return _signed_area(self.outline_um)
        factor = np.pi / 4 * (1 - self.inner_share**2) if self.round else 1.0
        width, height = self.sides_um
        return float(factor * (width * height))

    def scaled(self, across: float, up: float) -> Stop:
        """The stop stretched along x and y."""
        if self.outline_um:
            return Stop.polygon([(x * across, y * up) for x, y in self.outline_um])
        width, height = self.sides_um[0] * across, self.sides_um[1] * up
        if width == height:
            return replace(self, diameter_um=width, size_um=None if self.size_um is None else (width, height))
        shape: StopShape = {"circle": "ellipse", "square": "rectangle"}.get(self.shape, self.shape)  # type: ignore[assignment]
        return replace(self, shape=shape, diameter_um=max(width, height), size_um=(width, height))


_RATIO = re.compile(r"\s*[fF]\s*/\s*(\d+\.?\d*|\.\d+)\s*")


def stop_ratio(stop: object) -> bool:
    """Whether a stop, or a length of it, is stated by its ratio, such as "f/1.8"."""
    sizes = stop.values() if isinstance(stop, Mapping) else (stop,)
    return any(isinstance(size, str) and _RATIO.fullmatch(size) for size in sizes)


def _relative(size: object, focal_um: float) -> object:
    """A length, to the nanometre, in place of a ratio; anything else as it is."""
    match = _RATIO.fullmatch(size) if isinstance(size, str) else None
    if match is None:
        return size
    if not (ratio := float(match[1])):
        raise JobError("MF104", f"stop = {size!r} has no diameter", cure='Write a number above 0, such as "f/1.8"')
    return um_text(round(focal_um / ratio * NM_PER_UM) / NM_PER_UM)


def _signed_area(outline: Sequence[tuple[float, float]]) -> float:
    """Positive if the corners run counter-clockwise (the shoelace formula)."""
    ends = (*outline[1:], *outline[:1])
    return sum(x * v - u * y for (x, y), (u, v) in zip(outline, ends, strict=True)) / 2


@dataclass(frozen=True)
class Camera(Stated):
    """[camera]: the camera behind the panel, and the window of the sensor around the axis."""

    focal_um: Length
    """Focal length of the lens."""
    stop: Stop
    """The lens stop: the diameter of a circle, such as "f/1.8" of the focal length or "4 mm", or a table."""
    wavelengths_nm: Annotated[tuple[Wavelength, ...], Field(min_length=1, max_length=64, strict=False)]
    """One to 64 lines at which PSF and MTF are computed."""
    pixel_um: Length
    """Pixel pitch of the sensor."""
    window_um: Length = 256.0
    """Side of the PSF's window on the sensor; at most wavelength x focal / dot."""

    @classmethod
    def with_lengths(cls, stated: Any) -> Any:
        """The table with lengths in place of "f/1.8"."""
        if not isinstance(stated, Mapping) or not stop_ratio(stop := stated.get("stop")):
            return stated
        try:
            focal_um = length_um(stated.get("focal"))
        except JobError:
            # The focal length is at fault, and nothing is judged by a stop that follows from it.
            focal_um = 1.0
        if isinstance(stop, Mapping):
            return {**stated, "stop": {key: _relative(value, focal_um) for key, value in stop.items()}}
        return {**stated, "stop": _relative(stop, focal_um)}

    def __post_init__(self) -> None:
        for name in ("focal_um", "pixel_um", "window_um"):
            require.number(self, name)
        require.instance(self, "stop", Stop)
        require.instance(self, "wavelengths_nm", tuple)
        for line in self.wavelengths_nm:
            require.number(self, "wavelengths_nm", value=line)
        if not self.wavelengths_nm:
            require.refuse("MF105", self, "wavelengths_nm", "no wavelength is given", "Give at least one")

    @property
    def nyquist_cy_per_mm(self) -> float:
        """Half a cycle per pixel."""
        return UM_PER_MM / self.pixel_um / 2

    @property
    def middle_nm(self) -> float:
        """The line that stands for all of them where a number is too dear to find at each."""
        return median_nm(self.wavelengths_nm)


def median_nm(wavelengths_nm: Sequence[float]) -> float:
    """The median of wavelengths in any order: green of three, the longer of two."""
    return sorted(wavelengths_nm)[len(wavelengths_nm) // 2]


REFERENCE_TRANSMISSION = 0.2072
"""Share of the stop's light behind the published display."""
PHOTONS_PER_LUX_SECOND_UM2 = 4.09e3
"""On a square micrometre, at 555 nm: 1 / (683 lm/W) over the energy of a photon."""


def white_electrons(
    luminance: float,
    time_s: float,
    efficiency: float,
    focal_ratio: float,
    pixel_um: float,
    transmission: float = REFERENCE_TRANSMISSION,
) -> float:
    """Electrons of white of a luminance B in cd/m², on a pixel of a quantum efficiency, for a time in seconds.

    It lights the image plane by

        E = π B T / (4 N²)  lux                               (R. Kingslake, Optics in Photography, SPIE 1992, ch. 6)

    with N the focal ratio and T the share of the stop's light that the panel passes; one lux for one second is 4.09e15
    photons of 555 nm on a square metre (683 lm/W).
    """
    lux = math.pi * luminance * transmission / (4 * focal_ratio**2)
    return lux * time_s * PHOTONS_PER_LUX_SECOND_UM2 * pixel_um**2 * efficiency


@dataclass(frozen=True)
class Sensor(Stated):
    """[sensor]: what turns light into numbers; the defaults are those of protocol F1.

    ``simulate`` and ``run`` take photographs with it, and a ``design`` that searches is for it; a front of designs
    compares openings by F1's sensor.
    """

    full_well: Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)] = 15506.0
    """Most electrons that a pixel holds."""
    read_noise: Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)] = 4.87
    """Standard deviation of the read noise before the amplifier, electrons."""
    bits: Annotated[int, Field(ge=1, le=32)] | None = None
    """Bits of the converter, whose largest code is a full well at base gain; without it nothing is rounded."""
    black_level: Annotated[int, Field(ge=0)] = 0
    """Code of no light."""
    mosaic: Literal["none", "rggb"] = "none"
    """All colours at every pixel, or one of red, green, green and blue."""
    gain: Annotated[float, Field(ge=1, le=1e6, allow_inf_nan=False)] | None = None
    """Analog gain over base gain; left out, [exposure] picks the largest at which white fits the converter."""
    iso: Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)] | None = None
    """ISO speed in place of the gain; needs base_iso."""
    base_iso: Annotated[float, Field(gt=0, le=1e9, allow_inf_nan=False)] | None = None
    """ISO speed of base gain, by which the ISO of a file is a gain."""
    max_gain: Annotated[float, Field(ge=1, le=1e6, allow_inf_nan=False)] | None = None
    """Largest analog gain that is picked; 16 if left out."""
    converter_noise: Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)] | None = None
    """Standard deviation of the noise after the amplifier, in electrons at base gain; none if left out."""
    banding: Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)] | None = None
    """Standard deviation of what all pixels of a row have in common, electrons; none if left out."""

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
        self._check_gain()

    def _check_gain(self) -> None:
        for key in ("gain", "iso", "base_iso", "max_gain", "converter_noise", "banding"):
            value, least = getattr(self, key), 1.0 if "gain" in key else 0.0
            if value is not None and not (np.isfinite(value) and value >= least and (value > 0 or "iso" not in key)):
                raise _refused(
                    f"{key} of {value:g}", key, "Give a gain of 1 or more, an ISO above 0, noise of 0 or more"
                )
        if self.iso is not None and (self.base_iso is None or self.gain is not None):
            which = "both a gain and an ISO" if self.gain is not None else "an ISO without that of base gain"
            raise _refused(which, "iso", "Give gain alone, or iso with base_iso")
        gain = self.stated_gain or 1.0
        if not 1 <= gain <= (self.max_gain or math.inf):
            what = f"a gain of {gain:g} with a max_gain of {self.max_gain or math.inf:g}"
            raise _refused(what, "gain", "Give an ISO of base_iso or more, and a gain of max_gain or less")
        if not self._dark_noise(gain) < self.ceiling:
            what = (
                f"a noise in the dark of {self._dark_noise(gain):g} electrons with {self.ceiling:g} at the largest code"
            )
            raise _refused(what, "gain", "Give less noise, or less gain")

    @property
    def step(self) -> float:
        """Electrons of one code at base gain; 0 without a converter."""
        return 0.0 if self.bits is None else self.full_well / (2**self.bits - 1 - self.black_level)

    @property
    def stated_gain(self) -> float | None:
        """Analog gain over base gain, as gain or ISO state it."""
        return self.gain if self.iso is None or self.base_iso is None else self.iso / self.base_iso

    @property
    def known_gain(self) -> bool:
        """Whether the gain of a file is stated, or follows from its ISO."""
        return self.stated_gain is not None or self.base_iso is not None

    @property
    def ceiling(self) -> float:
        """Most electrons that are recorded: a full well, or at a stated gain its share."""
        return self.full_well / (self.stated_gain or 1.0)

    @property
    def amplifies(self) -> bool:
        """Whether its gain counts: something after the amplifier adds noise, or a gain is stated."""
        return self.bits is not None or bool(self.converter_noise) or self.stated_gain is not None

    @property
    def early_variance(self) -> float:
        """Variance of what is added before the amplifier, rows and pixels, in electrons²."""
        return self.read_noise**2 + (self.banding or 0.0) ** 2

    @property
    def late_variance(self) -> float:
        """Variance of what is added after the amplifier, rounding included, in electrons² at base gain."""
        return (self.converter_noise or 0.0) ** 2 + self.step**2 / 12

    def _dark_noise(self, gain: float) -> float:
        return math.sqrt(self.early_variance + ((self.converter_noise or 0.0) / gain) ** 2)

    def gain_for(self, electrons: Any) -> Any:
        """Analog gain of a photograph: as stated, or the largest at which white fits the converter.

        As a phone does it, white and three standard deviations of its noise stay below the largest code, and the gain
        is at most max_gain. It is 1 where nothing after the amplifier adds noise, or where white fills the well.

        Args:
            electrons: of white; a number, or an array or tensor of them.
        """
        if self.stated_gain is not None or not self.amplifies:
            return self.stated_gain or 1.0
        fits = self.full_well / (electrons + 3 * (electrons + self._dark_noise(1.0) ** 2) ** 0.5)
        most = self.max_gain or USUAL_MAX_GAIN
        return fits.clip(1.0, most) if hasattr(fits, "clip") else min(max(fits, 1.0), most)

    def amplified(self, gain: float) -> Sensor:
        """A sensor that at base gain records what this one does at another."""
        noise = self.read_noise
        if self.converter_noise:
            noise = math.hypot(noise, self.converter_noise / gain)
        return Sensor(
            self.full_well / gain, noise, self.bits, self.black_level, self.mosaic, gain=1.0, banding=self.banding
        )

    @property
    def facts(self) -> dict[str, Any]:
        """Keys and values; of gain and what goes with it those that are stated."""
        values = vars(self)
        return {key: values[key] for key in values if values[key] is not None or key in _ALWAYS}


_ALWAYS = ("full_well", "read_noise", "bits", "black_level", "mosaic")
USUAL_MAX_GAIN = 16.0
"""Between those of phones' sensors by their Linux drivers: 10.7 of Sony's IMX219, 22.3 of the IMX477."""


def _refused(what: str, key: str, cure: str) -> JobError:
    return JobError("MF140", f"{what} is no sensor", where=f"sensor.{key}", cure=cure)
