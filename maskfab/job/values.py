"""Values of a job file and their types: lengths and areas with their units, names, formats, spectra, corners.

A type is made of one of our parsers, whose errors pass through pydantic and come out as errors of ours that name the
key, and of the text that writes its values into a job file again.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from functools import cache, partial
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Literal, Self, TypeAlias, cast, get_args, get_type_hints

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    PlainSerializer,
    TypeAdapter,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from maskfab.base import units
from maskfab.base.errors import JobError


class Section(BaseModel):
    """A table of a job file: frozen, and refused if it has an unknown key or a value of the wrong type."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, defer_build=True)

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """Plain data by the keys of a job, those of tables that are :class:`Stated` too."""
        return super().model_dump(**{"by_alias": True, **options})


class _Fields:
    """Fields of a dataclass by their keys in a job, as pydantic has them of a :class:`Section`."""

    def __get__(self, instance: object, kind: type) -> Mapping[str, FieldInfo]:
        return _fields(kind)


@cache
def _fields(kind: Any) -> Mapping[str, FieldInfo]:
    hints = get_type_hints(kind, include_extras=True)
    return MappingProxyType(
        {
            key_of(field.name): FieldInfo.from_annotation(hints[field.name])
            if field.default is MISSING
            else FieldInfo.from_annotated_attribute(hints[field.name], field.default)
            for field in fields(kind)
        }
    )


def key_of(field: str) -> str:
    """The key of a job that states a field: its name without the unit."""
    return _UNIT.sub("", field)


_UNIT = re.compile("_(um|nm|waves)$")


class Stated:
    """A table of a job file that the machine takes as it is: a frozen dataclass, made by anyone from numbers in the
    units that its names end in, and from a job by pydantic, which takes each value with its unit.

    Limits of a key are held against jobs alone; what no value can mean, ``__post_init__`` refuses of all.
    """

    model_fields: ClassVar = _Fields()
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, alias_generator=key_of)

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        # A strict dataclass would take no table of a file, only an instance.
        table = cast(core_schema.DataclassSchema, handler(source))
        table["strict"] = False
        return core_schema.no_info_wrap_validator_function(
            lambda value, read: refusing(lambda stated: read(cls.with_lengths(stated)), value), table
        )

    @classmethod
    def with_lengths(cls, stated: Any) -> Any:
        """The table as a file states it, with lengths for what it states by another of its keys."""
        return stated

    @classmethod
    def model_validate(cls, values: object) -> Self:
        return cast(Self, _adapter(cls).validate_python(values))

    @classmethod
    def model_json_schema(cls) -> dict[str, Any]:
        return _adapter(cls).json_schema()

    def model_dump(self, **options: Any) -> dict[str, Any]:
        """Plain data by the keys of a job."""
        return cast(dict[str, Any], _adapter(type(self)).dump_python(self, by_alias=True, **options))


_adapter: Callable[[Any], TypeAdapter[Any]] = cache(TypeAdapter)

AnySection: TypeAlias = Section | Stated


def values_of(section: AnySection) -> Iterator[tuple[str, FieldInfo, Any]]:
    """Key, field and value of all that a table may state; a table in another form as its section."""
    names = type(section).model_fields if isinstance(section, Section) else (f.name for f in fields(cast(Any, section)))
    keys = type(section).model_fields.items()
    for (key, field), value in zip(keys, (getattr(section, name) for name in names), strict=True):
        yield key, field, value.as_stated() if hasattr(value, "stated_as") else value


def sections_of(field: FieldInfo) -> Iterator[type[AnySection]]:
    """The sections that a field holds."""
    stack: list[Any] = [field.annotation]
    while stack:
        kind = stack.pop(0)
        kind = getattr(kind, "stated_as", kind)
        if isinstance(kind, type) and issubclass(kind, AnySection):
            yield kind
        else:
            stack[:0] = get_args(kind)


PART = "\x1f"
"""Parts what from cure on the way through pydantic."""


def refusing(parse: Any, value: object, **options: object) -> Any:
    """Run one of our parsers inside pydantic, which then adds the place of the value."""
    try:
        return parse(value, **options)
    except JobError as error:
        # Without a context pydantic takes the text as it is, braces included.
        raise PydanticCustomError(error.code, error.what + PART + error.cure) from error


def parsed(parse: Callable[..., Any], **options: object) -> BeforeValidator:
    """Reader of the value of a key from what a file has there; a refusal gets the place of the value."""
    return BeforeValidator(lambda value: refusing(parse, value, **options))


def checks(method: Callable[[Any], None]) -> Any:
    """Check of a section when all its keys are there: a method that raises errors of ours."""

    def checked(section: Section) -> Section:
        refusing(method, section)
        return section

    return model_validator(mode="after")(checked)


WORD, NUMBER = "word", "number"


def word_or_number(value: object) -> str:
    """Which of the two a value is read as."""
    return WORD if isinstance(value, str) else NUMBER


_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")
_DEVICE = re.compile(r"(?i)con|prn|aux|nul|(?:com|lpt)[0-9]")
_AREA = re.compile(r"\s*(\S+?)\s*(nm|um|µm|mm)(?:\^2|2|²)\s*")
_LONGEST_UM = 1e9
_LARGEST_PLATE_UM = 2e6
_NEAREST_EYE_UM, _FARTHEST_EYE_UM = 1e4, 1e8
_MOST_COUNTS = 64

Method = Literal["search", "relax"]
METHODS: tuple[str, ...] = get_args(Method)
Symmetry = Literal["d4", "mirror", "rot180"]
Kissing = Literal["allowed", "cell", "neighbours"]
ObjectiveName = Literal["invertibility", "top_residual", "expected_error", "area"]
Weight = Annotated[float, Field(ge=0, le=1e9, allow_inf_nan=False)]

Layout: TypeAlias = Literal["gdsii", "oasis", "dxf_r12", "dxf_r2010"]
Solid: TypeAlias = Literal["step", "glb", "3mf", "stl"]
Picture: TypeAlias = Literal["png", "tiff"]
PlateBitmap: TypeAlias = Literal["plate_tiff", "plate_bmp"]
ShopFormat: TypeAlias = Literal[Layout, "gerber", "cif", PlateBitmap]
SHOP_FORMATS: tuple[ShopFormat, ...] = get_args(ShopFormat)
"""Formats that mask houses may take."""

DrawingUnit: TypeAlias = Literal["nm", "um", "mm", "mil", "in"]
"""Of a DXF, which need not say it."""

FileFormat: TypeAlias = Literal[Layout, "gerber", "cif", "svg", Solid, Picture, "exr", PlateBitmap]
"""Formats by their names in a job; the file of each in :mod:`maskfab.mask.formats` says all else of it."""

MASK_FORMATS: tuple[FileFormat, ...] = get_args(Layout)
"""Default formats of a plate."""

MEASURED_FORMATS: tuple[FileFormat, ...] = (*MASK_FORMATS, "cif")
"""Formats from which a plate's optics can be measured."""

SOLIDS: tuple[FileFormat, ...] = get_args(Solid)
PICTURES: tuple[FileFormat, ...] = get_args(Picture)
"""Formats of a die as pixels."""

PLATE_BITMAPS: tuple[PlateBitmap, ...] = get_args(PlateBitmap)
"""Formats of a whole plate as a plotter's dots."""

MOST_DOTS_PER_UM = 100
"""Pixels of a PNG or a TIFF in a micrometre."""


def check_name(name: object, *, where: str = "") -> str:
    """Refuse a name that mask houses would refuse in a GDSII library.

    Raises:
        JobError: MF110. A name has 1 to 24 letters, digits and underscores, a letter first (files carry suffixes
            within the 32 characters of GDSII), and nowhere "main", which mask houses keep for their own top cell. Nor
            is it a device of Windows, where no file can have its name.
    """
    if not isinstance(name, str):
        raise JobError("MF105", f"{name!r} is not text", where=where, cure='Write a name such as "TOLED_150"')
    if "main" in name.lower():
        problem = f'the name {name!r} holds "main", which mask houses refuse'
        raise JobError("MF110", problem, where=where, cure='Choose a name without "main", such as "TOLED_150"')
    if _DEVICE.fullmatch(name):
        problem = f"the name {name!r} is that of a device, and Windows has no file called so"
        raise JobError("MF110", problem, where=where, cure='Choose another name, such as "TOLED_150"')
    if not _NAME.fullmatch(name):
        what = (
            f"the name {name!r} of {len(name)} characters is not a letter followed by at most 23 letters, digits or "
            "underscores"
        )
        cure = 'Use a name such as "TOLED_150"; the name of a file is its stem unless one is given'
        raise JobError("MF110", what, where=where, cure=cure)
    return name


def _listed(value: object) -> object:
    return [value] if isinstance(value, str) else value


def um_text(value: float) -> str:
    """Micrometres as a job file writes them."""
    return f"{value:.15g} um"


def distance_text(value: float) -> str:
    """A distance, which may be infinite, as a job file writes it."""
    return "inf" if math.isinf(value) else um_text(value)


def length_um(value: object, *, zero_allowed: bool = False) -> float:
    """Micrometres of a length with its unit, at most 1 km (MF104); MF103 for a missing or wrong unit."""
    return _in_range(units.parse_length_um(value, zero_allowed=zero_allowed), value)


def _in_range(length: float, value: object) -> float:
    if length > _LONGEST_UM:
        raise JobError("MF104", f"{value!r} is longer than the limit of 1 km", cure="Give a length of at most 1 km")
    return length


def _pitch(value: object) -> float:
    return _in_range(float(f"{units.parse_pitch_um(value):.15g}"), value)  # densities give more digits than are meant


def _on_plate(value: object) -> float:
    length = length_um(value)
    if length > _LARGEST_PLATE_UM:
        what = f"{value!r} is more than 2 m, beyond what the coordinates of GDSII reach in steps of 1 nm"
        raise JobError("MF104", what, cure="Give a length of at most 2 m")
    return length


def _looked_from(value: object) -> float:
    length = length_um(value)
    if not _NEAREST_EYE_UM <= length <= _FARTHEST_EYE_UM:
        what = f"{value!r} is outside 10 mm to 100 m, from which displays are looked at"
        raise JobError("MF104", what, cure='A telephone is held at about "300 mm"')
    return length


def _drawn(text: object) -> object:
    """Text that the plate shows in letters of its own; its type is checked elsewhere."""
    lacking = sorted({c for c in text if not " " <= c <= "~"}) if isinstance(text, str) else []
    if lacking:
        what = f"the plate's font has no {', '.join(map(repr, lacking))} for the text {text!r}"
        raise JobError("MF110", what, cure="Use ASCII letters, digits and punctuation")
    return text


def _area(value: object) -> float:
    """Square micrometres of an area such as ``"1985 um^2"``."""
    match = _AREA.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise JobError("MF103", f"{value!r} is not an area with its unit", cure='Write it as "1985 um^2"')
    # A number times a unit squared is a length in that unit, times the unit once more.
    once = units.parse_length_um(f"{match[1]} {match[2]}", zero_allowed=True)
    return float(f"{once * units.parse_length_um(f'1 {match[2]}'):.15g}")


def _three(value: object) -> tuple[float, float, float]:
    parts = value if isinstance(value, list | tuple) else ()
    numbers = [part for part in parts if isinstance(part, int | float) and not isinstance(part, bool)]
    if len(parts) != 3 or len(numbers) != 3 or not all(math.isfinite(part) and part > 0 for part in numbers):
        what = f"{value!r} is not three positive numbers"
        raise JobError("MF116", what, cure="Give red, green and blue, such as [1, 1, 2]")
    red, green, blue = (float(part) for part in numbers)
    return red, green, blue


def length_keys(section: type[AnySection]) -> frozenset[str]:
    """Keys of a job file's section that hold one length each: those that are written as lengths."""
    return frozenset(
        key
        for key, field in section.model_fields.items()
        for mark in (*field.metadata, *(mark for kind in get_args(field.annotation) for mark in get_args(kind)[1:]))
        if isinstance(mark, PlainSerializer) and mark.func in (um_text, distance_text, _field_text)
    )


def checked_formats(formats: tuple[FileFormat, ...]) -> tuple[FileFormat, ...]:
    """Refuse formats of which the first is no layout, or one is named twice (MF105)."""
    if formats[0] not in MEASURED_FORMATS:
        what = f"{list(formats)}: the optics are measured from the first file, and {formats[0]} cannot be measured"
        raise JobError("MF105", what, cure=f"Put one of {', '.join(MEASURED_FORMATS)} first")
    if len(set(formats)) < len(formats):
        raise JobError("MF105", f"{list(formats)}: a format is named twice", cure="Name each once")
    return formats


def signed_length_um(value: object) -> float:
    """Micrometres of a length that may be negative; raises as :func:`length_um`."""
    if not (isinstance(value, str) and value.strip().startswith("-")):
        return length_um(value, zero_allowed=True)
    try:
        return -length_um(value.strip()[1:], zero_allowed=True)
    except JobError as error:
        what = f"{value!r} is no finite length of at most 1 km, with one sign and a unit"
        raise JobError(error.code, what, cure='Write it as "-0.1 um"') from error


def _listed_counts(value: object) -> object:
    """A table of ``from``, ``to`` and ``step`` as the list that it stands for; anything else as it is."""
    if not isinstance(value, dict):
        return value
    asked = {"step": 1, **value}
    if (
        asked.keys() != {"from", "to", "step"}
        or not all(type(number) is int for number in asked.values())
        or not 1 <= asked["from"] <= asked["to"]
        or asked["step"] < 1
    ):
        what = f"{value!r} is not a range of whole numbers from 1 upwards"
        raise JobError("MF105", what, cure="Write { from = 60, to = 110, step = 10 }, or a list")
    # One more than may be is enough to be refused.
    return list(islice(range(asked["from"], asked["to"] + 1, asked["step"]), _MOST_COUNTS + 1))


Length = Annotated[float, parsed(length_um), PlainSerializer(um_text)]
LengthOrZero = Annotated[float, parsed(length_um, zero_allowed=True), PlainSerializer(um_text)]
LookedFrom = Annotated[float, parsed(_looked_from), PlainSerializer(lambda v: f"{v / 1e3:.15g} mm")]
PlateLength = Annotated[float, parsed(_on_plate), PlainSerializer(um_text)]
Pitch = Annotated[float, parsed(_pitch), PlainSerializer(um_text)]
Wavelength = Annotated[float, parsed(units.parse_wavelength_nm), PlainSerializer("{:.15g} nm".format)]
DrawnText = Annotated[str, parsed(_drawn)]
Frequency = Annotated[float, parsed(units.parse_frequency_cy_per_mm), PlainSerializer(lambda v: f"{v:.15g} cy/mm")]
"""On the sensor, in cycles per millimetre."""
Names = Annotated[tuple[str, ...], BeforeValidator(_listed), Field(min_length=1, strict=False)]
Name = Annotated[str, parsed(check_name)]
Area = Annotated[float, parsed(_area), PlainSerializer("{:.15g} um^2".format)]
ThreeColours = Annotated[tuple[float, float, float], parsed(_three)]
SignedLength = Annotated[float, parsed(signed_length_um), PlainSerializer(um_text)]
Time = Annotated[float, parsed(units.parse_time_s), PlainSerializer(lambda v: f"{v:.15g} s")]
"""Seconds."""
Dpi = Annotated[int, parsed(units.parse_dpi), PlainSerializer(lambda v: f"{v} dpi")]
"""Dots per inch of a plotter."""
Formats = Annotated[
    tuple[FileFormat, ...], Field(min_length=1, strict=False), AfterValidator(partial(refusing, checked_formats))
]
Counts = Annotated[
    tuple[Annotated[int, Field(ge=1)], ...],
    Field(min_length=1, max_length=_MOST_COUNTS, strict=False),
    parsed(_listed_counts),
]

COLDEST_K, HOTTEST_K = 1000.0, 100_000.0
"""Temperatures of black bodies, kelvins."""

ACCURACIES: Mapping[str, float] = MappingProxyType({"draft": 1e-2, "standard": 1e-3, "certify": 1e-6})
"""Admissible relative L2 error of the PSF, by name."""

MOST_DISTORTION = 0.3
"""Beyond it a barrel folds the picture within the height at which it is stated."""

_TEMPERATURE = re.compile(r"\s*([-+]?(?:(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|inf))\s*(\S*)\s*")
_HIGHEST_NOLL = 66


def _distance(value: object) -> float:
    """Micrometres of a length, or infinity for ``"inf"``."""
    return math.inf if value == "inf" else length_um(value)


def _depth(value: object) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise JobError("MF105", f"{value!r} is not a pair of distances", cure='Write it as ["1 m", "inf"]')
    nearest, farthest = (_distance(distance) for distance in value)
    if nearest > farthest:
        what = f"{value!r} has the nearest object beyond the farthest"
        raise JobError("MF104", what, cure="Swap them: the nearest comes first")
    return nearest, farthest


def _accuracy(value: object) -> float:
    """Admissible relative L2 error of the PSF, by name or as a number in (0, 1)."""
    if isinstance(value, str) and value in ACCURACIES:
        return ACCURACIES[value]
    names = ", ".join(f'"{name}"' for name in ACCURACIES)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JobError("MF105", f"{value!r} is not an accuracy", cure=f"Use {names} or a number between 0 and 1")
    if not 0 < value < 1:
        raise JobError("MF104", f"{value!r} is outside 0 to 1", cure=f"Use {names} or a ratio such as 1e-3")
    return float(value)


def _aberrations(value: object) -> tuple[tuple[int, float], ...]:
    cure = "Write pairs of Noll's number and waves: [[4, 0.05], [11, 0.02]]"
    if not isinstance(value, list | tuple):
        raise JobError("MF105", f"{value!r} is not a list of pairs", cure=cure)
    terms: list[tuple[int, float]] = []
    for pair in value:
        if not isinstance(pair, list | tuple) or len(pair) != 2:
            raise JobError("MF105", f"{pair!r} is not a pair", cure=cure)
        term, waves = pair
        if type(term) is not int or type(waves) not in (int, float):
            raise JobError("MF105", f"{pair!r} is not a whole number and a number", cure=cure)
        if not 1 <= term <= _HIGHEST_NOLL:
            raise JobError("MF104", f"{pair!r} has a Noll index outside 1 to {_HIGHEST_NOLL}", cure=cure)
        if not math.isfinite(waves):
            raise JobError("MF104", f"{pair!r} has a coefficient that is not finite", cure=cure)
        if term in (number for number, _ in terms):
            raise JobError("MF105", f"{pair!r} repeats Noll's term {term}", cure="Give every term once")
        terms.append((term, float(waves)))
    return tuple(terms)


def _distortion(value: object) -> tuple[float, float]:
    """Relative displacement, and the image height where it was measured, in micrometres."""
    cure = 'Write it as { ratio = 0.02, height = "2 mm" }'
    if not isinstance(value, Mapping) or set(value) != {"ratio", "height"}:
        raise JobError("MF105", f"{value!r} is not a distortion and the image height where it was measured", cure=cure)
    ratio = value["ratio"]
    if type(ratio) not in (int, float):
        raise JobError("MF105", f"{ratio!r} is not a ratio", cure=cure)
    if not abs(ratio) <= MOST_DISTORTION:
        raise JobError("MF104", f"a distortion of {ratio!r} is beyond {MOST_DISTORTION:g}", cure="Write 0.02 for 2 %")
    return float(ratio), length_um(value["height"])


def is_table(name: str) -> bool:
    """Whether a text names a file of curves."""
    return Path(name).suffix.lower() == ".csv"


MOST_FIELD_DEG, MOST_TILT_DEG = 75.0, 10.0
"""Angles off the axis, and tilts of the panel, up to which the optics are proved."""

_DEGREES = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(?:deg|°)\s*")


def angle_deg(value: object, lowest: float = -MOST_FIELD_DEG, highest: float = MOST_FIELD_DEG) -> float:
    """Degrees of an angle such as ``"60 deg"``. Raises JobError MF103 without that unit, MF104 out of range."""
    match = _DEGREES.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise JobError("MF103", f"{value!r} is not an angle with its unit", cure='Write it as "20 deg"')
    angle = float(f"{float(match[1]):.15g}")
    if not lowest <= angle <= highest:
        what = f"{value!r} is outside {lowest:g} to {highest:g} degrees, where the optics are proved"
        raise JobError("MF104", what, cure=f'Give an angle within, such as "{highest:g} deg"')
    return angle


def _field(value: object) -> float | str:
    """Micrometres of a largest image height, or an angle off the axis as text."""
    if isinstance(value, str) and _DEGREES.fullmatch(value):
        return f"{angle_deg(value, 0.0):.15g} deg"
    return length_um(value, zero_allowed=True)


def _field_text(value: float | str) -> str:
    return value if isinstance(value, str) else um_text(value)


def _word_or_table(value: object, noun: str, words: tuple[str, str], example: str) -> str:
    if not isinstance(value, str) or not (value in words or is_table(value)):
        what = f"{value!r} is not a {noun}"
        raise JobError("MF105", what, cure=f'Use "{words[0]}", "{words[1]}" or a file such as "{example}"')
    return value


def _illuminant(value: object) -> str | float:
    """``"equal"``, the name of a file of one curve, or a black body's temperature in kelvins."""
    if isinstance(value, str) and (value == "equal" or is_table(value)):
        return value
    cure = 'Use "equal", a temperature such as "6500 K" or a file such as "light.csv"'
    match = None if isinstance(value, bool) else _TEMPERATURE.fullmatch(str(value))
    if match is None:
        raise JobError("MF105", f"{value!r} is not an illuminant", cure=cure)
    if match[2] != "K":
        problem = "no unit" if not match[2] else f"the unit {match[2]!r}, which is no kelvin"
        raise JobError("MF103", f"{value!r} has {problem}", cure=cure)
    # As with lengths: 15 digits, which are written out and read again as they are.
    kelvins = float(f"{float(match[1]):.15g}")
    if not COLDEST_K <= kelvins <= HOTTEST_K:
        what = f"{value!r} is outside {COLDEST_K:g} K to {HOTTEST_K:g} K"
        raise JobError("MF104", what, cure="Daylight is about 6500 K")
    return kelvins


Spectrum = Annotated[str, parsed(_word_or_table, noun="spectrum", words=("lines", "rgb"), example="camera.csv")]
Illuminant = Annotated[
    str | float, parsed(_illuminant), PlainSerializer(lambda v: f"{v:.15g} K" if isinstance(v, float) else v)
]
FieldReach = Annotated[float | str, parsed(_field), PlainSerializer(_field_text)]
LensProjection = Annotated[
    str, parsed(_word_or_table, noun="projection", words=("f tan", "f theta"), example="lens.csv")
]
Tilt = Annotated[
    float, parsed(angle_deg, lowest=-MOST_TILT_DEG, highest=MOST_TILT_DEG), PlainSerializer(lambda v: f"{v:.15g} deg")
]
"""Degrees."""
Distance = Annotated[float, parsed(_distance), PlainSerializer(distance_text)]
Depth = Annotated[tuple[float, float], parsed(_depth), PlainSerializer(lambda v: [*map(distance_text, v)])]
Accuracy = Annotated[float, parsed(_accuracy)]
Aberrations = Annotated[tuple[tuple[int, float], ...], parsed(_aberrations)]
LensDistortion = Annotated[
    tuple[float, float], parsed(_distortion), PlainSerializer(lambda v: {"ratio": v[0], "height": um_text(v[1])})
]

_MOST_CORNERS = 256
_CURE = 'Write pairs of x and y: [["1 mm", "0 mm"], ["0 mm", "1 mm"], ["-1 mm", "-1 mm"]]'

Corner = tuple[float, float]


def _coordinate(value: object) -> float:
    """Micrometres of a length that may be negative or zero."""
    text = value.strip() if isinstance(value, str) else value
    if isinstance(text, str) and text.startswith("-"):
        return -length_um(text[1:], zero_allowed=True)
    return length_um(text, zero_allowed=True)


def _corners(value: object) -> tuple[Corner, ...]:
    """Corners of a polygon of 3 to 256 corners whose sides meet only where one follows the other; MF132 for others."""
    if not isinstance(value, list | tuple) or not all(isinstance(p, list | tuple) and len(p) == 2 for p in value):
        raise JobError("MF105", f"{value!r} is not a list of pairs", cure=_CURE)
    if len(value) < 3:
        raise JobError("MF132", f"{len(value)} corners hold no area; 3 are needed", cure=_CURE)
    if len(value) > _MOST_CORNERS:
        what = f"{len(value)} corners are more than {_MOST_CORNERS}"
        raise JobError("MF115", what, cure="Draw the stop with fewer corners")
    corners = tuple((_coordinate(x), _coordinate(y)) for x, y in value)
    _refuse_crossing(corners)
    return corners


def _refuse_crossing(corners: Sequence[Corner]) -> None:
    sides = list(zip(corners, (*corners[1:], *corners[:1]), strict=True))
    for k, first in enumerate(sides):
        if first[0] == first[1]:
            raise JobError("MF132", f"corner {k + 1} and the next coincide", cure="Remove one of the two corners")
        for j in range(k + 1, len(sides)):
            second = sides[j]
            if j == k + 1 or (k == 0 and j == len(sides) - 1):
                shared, before, after = (
                    (first[1], first[0], second[1]) if j == k + 1 else (first[0], first[1], second[0])
                )
                meet = _turn(before, shared, after) == 0 and _ahead(before, shared, after)
            else:
                meet = _cross(*first, *second)
            if meet:
                what = f"sides {k + 1} and {j + 1} cross or touch"
                raise JobError("MF132", what, cure="Give the corners in order round the stop")


def _turn(p: Corner, q: Corner, r: Corner) -> float:
    """Positive if p, q, r turn left; 0 on a line, up to rounding."""
    turn = (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    return 0.0 if abs(turn) <= 1e-12 * math.dist(p, q) * math.dist(p, r) else turn


def _ahead(p: Corner, q: Corner, r: Corner) -> bool:
    """Whether the way from q to r leads back along that from p to q."""
    return (q[0] - p[0]) * (r[0] - q[0]) + (q[1] - p[1]) * (r[1] - q[1]) < 0


def _cross(p: Corner, q: Corner, r: Corner, s: Corner) -> bool:
    """Whether two sides have a place in common."""
    turns = _turn(p, q, r), _turn(p, q, s), _turn(r, s, p), _turn(r, s, q)
    if all(turns):
        return (turns[0] > 0) != (turns[1] > 0) and (turns[2] > 0) != (turns[3] > 0)
    ends = (p, q, r), (p, q, s), (r, s, p), (r, s, q)
    return any(turn == 0 and _between(*end) for turn, end in zip(turns, ends, strict=True))


def _between(p: Corner, q: Corner, r: Corner) -> bool:
    """Whether r, which is in line with p and q, lies between them."""
    return all(min(a, b) <= c <= max(a, b) for a, b, c in zip(p, q, r, strict=True))


Corners = Annotated[
    tuple[Corner, ...], parsed(_corners), PlainSerializer(lambda v: [[um_text(x), um_text(y)] for x, y in v])
]
