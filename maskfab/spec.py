"""The job file: what the user asks for, validated completely before any work starts.

Every length is written with its unit (``"168 um"``); a validated spec holds micrometres and nanometres, and dumps back
to text that loads to the same spec.
"""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, PlainSerializer, ValidationError
from pydantic_core import PydanticCustomError

from maskfab import units
from maskfab.errors import JobError, SourceError
from maskfab.model import Camera, Stop, Tiling

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,23}")
_MOST_DOTS_ACROSS_STOP = 6000
_MOST_SAMPLES = 4096
_PART = "\x1f"  # parts what from cure on the way through pydantic
_LONGEST_UM = 1e9
_LARGEST_PLATE_UM = 2e6
_HIGHEST_NOLL = 66

ACCURACIES: Mapping[str, float] = MappingProxyType({"draft": 1e-2, "standard": 1e-3, "certify": 1e-6})
"""Admissible relative L2 error of the PSF, by name."""


def _refusing(parse: Any, value: object, **options: object) -> Any:
    """Run one of our parsers inside pydantic, which then adds the place of the value."""
    try:
        return parse(value, **options)
    except JobError as error:
        # Without a context pydantic takes the text as it is, braces included.
        raise PydanticCustomError(error.code, error.what + _PART + error.cure) from error


def check_name(name: object, *, where: str = "") -> str:
    """Refuse a name that mask houses would refuse in a GDSII library.

    Raises:
        JobError: MF110. A name has 1 to 24 letters, digits and underscores, a letter first (files carry suffixes
            within the 32 characters of GDSII), and nowhere "main", which mask houses keep for their own top cell.
    """
    if not isinstance(name, str):
        raise JobError("MF105", f"{name!r} is not text", where=where, cure='Write a name such as "TOLED_150"')
    if "main" in name.lower():
        problem = f'the name {name!r} holds "main", which mask houses refuse'
        raise JobError("MF110", problem, where=where, cure="Choose another")
    if not _NAME.fullmatch(name):
        raise JobError(
            "MF110",
            f"the name {name!r} of {len(name)} characters is not a letter followed by at most 23 letters, digits or "
            "underscores",
            where=where,
            cure='Use a name such as "TOLED_150"; the name of a file is its stem unless one is given',
        )
    return name


def _um_text(value: float) -> str:
    return f"{value:.15g} um"


def _nm_text(value: float) -> str:
    return f"{value:.15g} nm"


def _length(value: object, *, zero_allowed: bool = False) -> float:
    length = units.parse_length_um(value, zero_allowed=zero_allowed)
    if length > _LONGEST_UM:
        raise JobError("MF104", f"{value!r} is longer than the limit of 1 km", cure="Give a shorter length")
    return length


def _pitch(value: object) -> float:
    pitch = units.parse_pitch_um(value)
    return _length(f"{pitch:.15g} um")


def _on_plate(value: object) -> float:
    length = _length(value)
    if length > _LARGEST_PLATE_UM:
        raise JobError(
            "MF104",
            f"{value!r} is more than 2 m, beyond what the coordinates of GDSII reach in steps of 1 nm",
            cure="Give a shorter length",
        )
    return length


Length = Annotated[float, BeforeValidator(lambda v: _refusing(_length, v)), PlainSerializer(_um_text)]
LengthOrZero = Annotated[
    float,
    BeforeValidator(lambda v: _refusing(_length, v, zero_allowed=True)),
    PlainSerializer(_um_text),
]
PlateLength = Annotated[float, BeforeValidator(lambda v: _refusing(_on_plate, v)), PlainSerializer(_um_text)]
Pitch = Annotated[float, BeforeValidator(lambda v: _refusing(_pitch, v)), PlainSerializer(_um_text)]
Wavelength = Annotated[
    float, BeforeValidator(lambda v: _refusing(units.parse_wavelength_nm, v)), PlainSerializer(_nm_text)
]
DrawnText = Annotated[str, BeforeValidator(lambda v: _refusing(_drawn, v))]
Name = Annotated[str, BeforeValidator(lambda v: _refusing(check_name, v))]


def _drawn(text: object) -> object:
    """Text that the plate shows in letters of its own; its type is checked elsewhere."""
    lacking = sorted({c for c in text if not " " <= c <= "~"}) if isinstance(text, str) else []
    if lacking:
        raise JobError(
            "MF110",
            f"the plate's font has no {', '.join(map(repr, lacking))} for the text {text!r}",
            cure="Use ASCII letters, digits and punctuation",
        )
    return text


def _distance(value: object) -> float:
    """Micrometres of a length, or infinity for ``"inf"``."""
    return math.inf if value == "inf" else _length(value)


def _distance_text(value: float) -> str:
    return "inf" if math.isinf(value) else _um_text(value)


def _depth(value: object) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise JobError("MF105", f"{value!r} is not a pair of distances", cure='Write it as ["1 m", "inf"]')
    nearest, farthest = (_distance(each) for each in value)
    if nearest > farthest:
        raise JobError(
            "MF104", f"{value!r} has the nearest object beyond the farthest", cure="Swap them: the nearest comes first"
        )
    return nearest, farthest


def _accuracy(value: object) -> float:
    """Admissible relative L2 error of the PSF, by name or as a number in (0, 1)."""
    if isinstance(value, str) and value in ACCURACIES:
        return ACCURACIES[value]
    names = ", ".join(f'"{name}"' for name in ACCURACIES)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise JobError("MF105", f"{value!r} is no accuracy", cure=f"Use {names} or a number between 0 and 1")
    if not 0 < value < 1:
        raise JobError("MF104", f"{value!r} is outside 0 to 1", cure=f"Use {names} or a ratio such as 1e-3")
    return float(value)


def _aberrations(value: object) -> tuple[tuple[int, float], ...]:
    cure = "Write pairs of Noll's number and waves: [[4, 0.05], [11, 0.02]]"
    if not isinstance(value, list | tuple):
        raise JobError("MF105", f"{value!r} is not a list of pairs", cure=cure)
    found: list[tuple[int, float]] = []
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
        if term in (known for known, _ in found):
            raise JobError("MF105", f"{pair!r} gives Noll's term {term} once more", cure="Give every term once")
        found.append((term, float(waves)))
    return tuple(found)


Distance = Annotated[float, BeforeValidator(lambda v: _refusing(_distance, v)), PlainSerializer(_distance_text)]
Depth = Annotated[
    tuple[float, float],
    BeforeValidator(lambda v: _refusing(_depth, v)),
    PlainSerializer(lambda v: [_distance_text(each) for each in v]),
]
Accuracy = Annotated[float, BeforeValidator(lambda v: _refusing(_accuracy, v))]
Aberrations = Annotated[tuple[tuple[int, float], ...], BeforeValidator(lambda v: _refusing(_aberrations, v))]


class _Section(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


Section = TypeVar("Section", bound=_Section)


class JobSection(_Section):
    """[job]: what the plate is called."""

    name: Name
    title: DrawnText = Field(max_length=80)


class StopSection(_Section):
    """camera.stop: the lens aperture."""

    shape: Literal["circle", "square"] = "circle"
    diameter: Length


class CameraSection(_Section):
    """[camera]: what looks through the panel, and how much of the sensor around the axis is looked at."""

    focal: Length
    stop: StopSection
    wavelengths: Annotated[tuple[Wavelength, ...], Field(min_length=1, max_length=64, strict=False)]
    pixel: Length
    window: Length = 256.0

    def camera(self) -> Camera:
        """The camera of the model."""
        stop = Stop(self.stop.shape, self.stop.diameter)
        return Camera(self.focal, stop, self.wavelengths, self.pixel, self.window)


class PlateSection(_Section):
    """[plate]: the blank and how dies are arranged on it."""

    blank: PlateLength
    writable: PlateLength
    die_size: PlateLength
    die_pitch: PlateLength
    columns: int = Field(ge=1, le=100)


class LimitsSection(_Section):
    """[limits]: what a die must keep to; what is left out is reported without judgement."""

    corner_touches: int | None = Field(default=None, ge=0)
    min_feature: Length | None = None
    min_space: Length | None = None


class DieSection(_Section):
    """[[die]]: one opening laid out as one panel.

    ``opening`` is a key of [openings], or the path of a file relative to the job file; ``opening_layer`` and
    ``opening_cell`` say where in a layout file it is.
    """

    name: Name
    label: DrawnText = Field(min_length=1, max_length=40)
    opening: str
    opening_layer: str | None = None
    opening_cell: str | None = None
    dot: Length
    pitch: Pitch | None = None
    gutter: LengthOrZero = 0.0
    tiling: Annotated[Tiling, Field(strict=False)]
    seed: int | None = Field(default=None, ge=0)


class DesignSection(_Section):
    """[design]: an opening to be found."""

    name: Name
    dots: int = Field(ge=1, le=128)
    pitch: Pitch
    open_ratio: float = Field(gt=0, le=1, allow_inf_nan=False)
    tiling: Annotated[Tiling, Field(strict=False)]
    tiling_seed: int | None = Field(default=None, ge=0)
    seed: int = Field(ge=0)
    iterations: int = Field(default=300, ge=1, le=100_000)
    epsilon: float = Field(default=0.015, gt=0, le=1, allow_inf_nan=False)
    worst_fraction: float = Field(default=0.3, gt=0, le=1, allow_inf_nan=False)
    output: str | None = None


class SceneSection(_Section):
    """[scene]: what the camera looks at and how accurate the PSF must be; the defaults ask for nothing extra.

    ``depth`` is the nearest and the farthest object, ``field`` the largest image height, ``gap`` the distance from the
    panel to the stop; ``aberrations`` are pairs of Noll's number and waves at the first wavelength.
    """

    accuracy: Accuracy = 1e-3
    depth: Depth = (math.inf, math.inf)
    focus: Distance = math.inf
    field: LengthOrZero = 0.0
    gap: LengthOrZero = 0.0
    aberrations: Aberrations = ()
    saturation: bool = False
    spectrum: Literal["lines", "rgb"] = "lines"


class JobSpec(_Section):
    """A whole job file. ``openings`` holds opening files by the names that dies use, to make a job self-contained."""

    job: JobSection | None = None
    camera: CameraSection
    plate: PlateSection | None = None
    limits: LimitsSection = LimitsSection()
    die: Annotated[tuple[DieSection, ...], Field(strict=False)] = ()
    design: DesignSection | None = None
    scene: SceneSection | None = None
    openings: dict[str, str] = {}

    def dump(self) -> dict[str, Any]:
        """Plain data that loads to an equal spec; defaults are written out, so that they are part of the job's hash."""
        return self.model_dump(mode="json", exclude_none=True)


def read(path: Path) -> JobSpec:
    """Load and validate a job file (.toml, or the .json that a run keeps).

    Raises:
        SourceError: MF301, MF302, MF303 or MF308 if the file cannot be read.
        JobError: MF101 to MF115 for the first thing that is wrong with its content.
    """
    if not path.is_file():
        raise SourceError("MF301", f"there is no job file {path}", cure="Check the path")
    data = path.read_bytes()
    if not data.strip():
        raise SourceError("MF302", f"the job file {path} is empty", cure="Start from layouts/upc12.toml")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SourceError("MF304", f"the job file {path} is not text: {error}", cure="Save it as UTF-8") from error
    if path.suffix == ".json":
        try:
            document = json.loads(text)
        except json.JSONDecodeError as error:
            raise SourceError("MF303", f"{path} is not valid JSON: {error}", cure="Run the job again") from error
    elif path.suffix == ".toml":
        document = _toml(text, str(path))
    else:
        raise SourceError("MF308", f"{path} has the suffix {path.suffix!r}", cure="A job file ends in .toml")
    return validate(document, where=str(path))


def validate(document: object, *, where: str) -> JobSpec:
    """A spec from parsed data; ``where`` names the file in errors."""
    spec = parse_section(JobSpec, document, where=where)
    _check_dies(spec, where)
    _check_scene(spec, where)
    return spec


def parse_section(kind: type[Section], values: object, *, where: str) -> Section:
    """One section from values that did not come from a file; errors as for a job."""
    try:
        return kind.model_validate(values)
    except ValidationError as error:
        raise _first(error, where) from error


def _toml(text: str, where: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = re.search(r"line (\d+), column (\d+)", str(error))
        place = f"{where}:{found[1]}:{found[2]}" if found else f"{where}, at the end"
        raise JobError("MF101", f"TOML syntax: {error}", where=place, cure="Mend the syntax there") from error


def _first(error: ValidationError, where: str) -> JobError:
    """The first problem pydantic found, as an error of ours that names the key; the number of others is told.

    An unknown key comes first of all: a misspelt one is also missing under its true name.
    """
    problems = sorted(error.errors(include_url=False), key=lambda p: p["type"] != "extra_forbidden")
    problem = problems[0]
    # A list of which one item is wrong may also count as too short; that is no problem of its own.
    more = sum(p["loc"] != problem["loc"][: len(p["loc"])] for p in problems)
    key = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in problem["loc"]).lstrip(".") or "the file"
    place = f"{where}: {key}"
    others = f"; {more} more problem{'s follow' if more > 1 else ' follows'}" if more else ""
    kind = problem["type"]
    if kind.startswith("MF"):
        what, _, cure = problem["msg"].partition(_PART)
        return JobError(kind, f"{key} = {what}{others}" if kind != "MF110" else what + others, where=place, cure=cure)
    if kind == "extra_forbidden":
        return JobError("MF102", f"unknown key {key!r}{others}", where=place, cure="Remove it, or mend its spelling")
    if kind == "missing":
        return JobError("MF105", f"the key {key!r} is missing{others}", where=place, cure=f"Add {key}")
    code = "MF104" if kind in _OUT_OF_RANGE else "MF105"
    what = f"{key} = {problem['input']!r}: {problem['msg'][0].lower()}{problem['msg'][1:]}{others}"
    return JobError(code, what, where=place, cure=f"Change {key}")


_OUT_OF_RANGE = frozenset({"greater_than", "greater_than_equal", "less_than", "less_than_equal", "finite_number"})


def _check_dies(spec: JobSpec, where: str) -> None:
    """What one section alone cannot tell."""
    for name, count in Counter(die.name for die in spec.die).items():
        if count > 1:
            raise JobError(
                "MF109", f"{count} dies have the name {name!r}", where=f"{where}: die", cure="Rename all but one"
            )
    for number, die in enumerate(spec.die):
        place = f"{where}: die[{number}]"
        if die.tiling is not Tiling.PERIODIC and die.seed is None:
            raise JobError(
                "MF111",
                f"die {die.name!r} is tiled {die.tiling} without a seed",
                where=f"{place}.seed",
                cure="Add seed = 1",
            )
        units.to_nm(die.dot, where=f"{place}.dot", name="dot")
        even_nm(die.gutter, where=f"{place}.gutter", name="gutter")
        check_optics(spec.camera.camera(), die.dot, where=place)


def _check_scene(spec: JobSpec, where: str) -> None:
    """Objects within the focal length have no image."""
    if spec.scene is None:
        return
    for key, distance in (("depth", spec.scene.depth[0]), ("focus", spec.scene.focus)):
        if not distance > spec.camera.focal:
            raise JobError(
                "MF104",
                f"{distance:g} um is not beyond the focal length of {spec.camera.focal:g} um",
                where=f"{where}: scene.{key}",
                cure="Give a distance from the lens, beyond its focal length",
            )


def even_nm(value_um: float, *, where: str, name: str) -> int:
    """Integer nanometres of a length of which either half must lie on the database grid (MF107 otherwise)."""
    value_nm = units.to_nm(value_um, where=where, name=name)
    if value_nm % 2:
        raise JobError(
            "MF107",
            f"{name} {value_um:g} um is an odd number of nanometres, half of which is off the 1 nm grid",
            where=where,
            cure=f"Use {value_um + 1e-3:g} um",
        )
    return value_nm


def check_optics(camera: Camera, dot_um: float, *, where: str) -> None:
    """Refuse a window with replicas of the PSF in it, and an aperture or a PSF too fine to hold.

    Raises:
        JobError: MF105 if a wavelength is there twice; MF113 if the window is wider than λf/dot at the shortest
            wavelength; MF115 if the stop is more than 6000 dots across, or the window more than 4096 samples wide.
    """
    twice = [line for line, count in Counter(camera.wavelengths_nm).items() if count > 1]
    if twice:
        raise JobError(
            "MF105",
            f"the wavelength {twice[0]:g} nm is given more than once",
            where=f"{where}: camera.wavelengths",
            cure="Give every wavelength once",
        )
    shortest = min(camera.wavelengths_nm)
    limit = shortest * 1e-3 * camera.focal_um / dot_um
    if camera.window_um > limit:
        raise JobError(
            "MF113",
            f"window {camera.window_um:g} um is wider than λf/dot = {limit:.1f} um at {shortest:g} nm for a dot of "
            f"{dot_um:g} um",
            where=f"{where}: camera.window",
            cure=f"Use a window of at most {math.floor(limit * 10) / 10:g} um",
        )
    if camera.window_um < camera.pixel_um:
        raise JobError(
            "MF104",
            f"window {camera.window_um:g} um is smaller than one sensor pixel of {camera.pixel_um:g} um",
            where=f"{where}: camera.window",
            cure="Use a window of many pixels",
        )
    across = camera.stop.diameter_um / dot_um
    if across > _MOST_DOTS_ACROSS_STOP:
        raise JobError(
            "MF115",
            f"a stop of {camera.stop.diameter_um:g} um is {across:.0f} dots of {dot_um:g} um across; the limit is "
            f"{_MOST_DOTS_ACROSS_STOP}",
            where=where,
            cure="Use a smaller stop or a coarser dot",
        )
    finest = min(camera.pixel_um, shortest * 1e-3 * camera.focal_um / camera.stop.diameter_um) / 2
    samples = camera.window_um / finest
    if samples > _MOST_SAMPLES:
        raise JobError(
            "MF115",
            f"a window of {camera.window_um:g} um is {samples:.0f} samples of {finest:g} um wide; the limit is "
            f"{_MOST_SAMPLES}",
            where=f"{where}: camera.window",
            cure=f"Use a window of at most {math.floor(_MOST_SAMPLES * finest * 10) / 10:g} um, or a larger pixel",
        )
