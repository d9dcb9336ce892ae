"""The sections of a job file, and the whole of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

from maskfab.errors import JobError
from maskfab.jobfile.design_values import Method, ObjectiveName, Weight
from maskfab.jobfile.display_values import Area, ThreeColours
from maskfab.jobfile.export_values import MASK_FORMATS, MOST_DOTS_PER_UM, Formats, SignedLength
from maskfab.jobfile.pareto_values import Counts
from maskfab.jobfile.problems import refusing
from maskfab.jobfile.scene_values import Aberrations, Accuracy, Depth, Distance, Illuminant, Spectrum
from maskfab.jobfile.stop_values import Corners
from maskfab.jobfile.values import DrawnText, Length, LengthOrZero, Name, Pitch, PlateLength, Wavelength
from maskfab.model import Camera, Glass, MaskBlank, Process, Stop, StopShape, Tiling


class Section(BaseModel):
    """A table of a job file: frozen, and refused if it has an unknown key or a value of the wrong type."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class JobSection(Section):
    """[job]: name and title of the plate."""

    name: Name
    title: DrawnText = Field(max_length=80)


class StopSection(Section):
    """camera.stop: the lens aperture, the optical axis in its middle or, for a polygon, at the corners' origin.

    A circle and a square have a ``diameter``, an annulus an ``inner`` one as well, an ellipse and a rectangle ``width``
    and ``height``, a polygon ``corners``: pairs of x and y in either sense of rotation, its sides not crossing.
    """

    shape: StopShape = "circle"
    diameter: Length | None = None
    inner: Length | None = None
    width: Length | None = None
    height: Length | None = None
    corners: Corners | None = None

    @model_validator(mode="after")
    def _of_its_shape(self) -> StopSection:
        """The keys of the shape, all of them and no others."""
        return refusing(_whole, self)  # type: ignore[no-any-return]

    def stop(self) -> Stop:
        """The stop of the model."""
        if self.corners is not None:
            return Stop.polygon(self.corners)
        if self.width is not None and self.height is not None:
            return (
                Stop.ellipse(self.width, self.height)
                if self.shape == "ellipse"
                else Stop.rectangle(self.width, self.height)
            )
        assert self.diameter is not None
        return Stop.annulus(self.diameter, self.inner) if self.inner is not None else Stop(self.shape, self.diameter)


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


def _whole(section: StopSection) -> StopSection:
    wanted = _STOP_KEYS[section.shape]
    stated = {key for key in type(section).model_fields if key != "shape" and getattr(section, key) is not None}
    missing, spare = [key for key in wanted if key not in stated], sorted(stated.difference(wanted))
    if missing or spare:
        problem = f"lacks {' and '.join(missing)}" if missing else f"has {' and '.join(spare)}, which means nothing"
        cure = f"Give {' and '.join(wanted)}, and nothing else"
        raise JobError("MF105", f"a stop of the shape {section.shape!r} {problem}", cure=cure)
    if section.inner is not None and section.diameter is not None and section.inner >= section.diameter:
        raise JobError(
            "MF132",
            f"an annulus of {section.diameter:g} um with a dark middle of {section.inner:g} um passes nothing",
            cure="Give an inner diameter below the outer one",
        )
    return section


class CameraSection(Section):
    """[camera]: the camera behind the panel, and the window of the sensor around the axis."""

    focal: Length
    stop: StopSection
    wavelengths: Annotated[tuple[Wavelength, ...], Field(min_length=1, max_length=64, strict=False)]
    pixel: Length
    window: Length = 256.0

    def camera(self) -> Camera:
        """The camera of the model."""
        return Camera(self.focal, self.stop.stop(), self.wavelengths, self.pixel, self.window)


class GlassSection(Section):
    """plate.glass: its thickness, its refractive index, and whether the chrome is towards the lens or away from it."""

    thickness: Length
    index: float = Field(ge=1, le=4, allow_inf_nan=False)
    chrome: Literal["lens", "away"]


class BlankSection(Section):
    """Chrome and glass of [plate]; what is left out is part of the model bar instead of the model.

    ``optical_density`` is that of the chrome, ``film_phase`` the phase lag, in waves, of
    the light that leaks through it, the same at every line.
    """

    optical_density: float | None = Field(default=None, gt=0, le=12, allow_inf_nan=False)
    film_phase: float | None = Field(default=None, ge=-1, le=1, allow_inf_nan=False)
    glass: GlassSection | None = None

    @model_validator(mode="after")
    def _phase_of_something(self) -> Self:
        return refusing(_with_density, self)  # type: ignore[no-any-return]

    def mask_blank(self) -> MaskBlank:
        """The mask blank, in the model's terms."""
        glass = None if self.glass is None else Glass(self.glass.thickness, self.glass.index, self.glass.chrome)
        return MaskBlank(self.optical_density, self.film_phase, glass)


def _with_density(section: BlankSection) -> BlankSection:
    if section.film_phase is not None and section.optical_density is None:
        raise JobError(
            "MF105",
            "film_phase is given without optical_density",
            cure="Add optical_density, such as 3, or remove film_phase",
        )
    return section


class PlateSection(BlankSection):
    """[plate]: the blank and how dies are arranged on it.

    ``template`` names a file of export_templates/plates/ that states the blank, its writable area and its marks;
    without one, ``blank`` and ``writable`` are required.
    """

    template: str | None = None
    blank: PlateLength | None = None
    writable: PlateLength | None = None
    die_size: PlateLength
    die_pitch: PlateLength
    columns: int = Field(ge=1, le=100)


class LimitsSection(Section):
    """[limits]: limits of every die; quantities without a limit are reported without a verdict."""

    corner_touches: int | None = Field(default=None, ge=0)
    min_feature: Length | None = None
    min_space: Length | None = None


class DieSection(Section):
    """[[die]]: one opening laid out as one panel.

    ``opening`` is a key of [openings], or the path of a file relative to the job file; ``opening_layer`` and
    ``opening_cell`` locate it in a layout file. ``others`` are further openings: every cell draws one of all.
    ``map``, for the tiling of that name, is a key of [maps] or the path of a file.
    """

    name: Name
    label: DrawnText = Field(min_length=1, max_length=40)
    opening: str
    opening_layer: str | None = None
    opening_cell: str | None = None
    others: Annotated[tuple[str, ...], Field(min_length=1, max_length=14, strict=False)] | None = None
    dot: Length
    pitch: Pitch | None = None
    gutter: LengthOrZero = 0.0
    tiling: Annotated[Tiling, Field(strict=False)]
    map: str | None = None
    seed: int | None = Field(default=None, ge=0)


class RulesSection(Section):
    """design.rules: rules of the opening; see :class:`maskfab.design.rules.constraints.Constraints` for each.

    ``rim_dots`` is the gutter, half of it on each side: cells meet with twice as many closed dots between them.
    ``footprint`` is the least share of the pixel that each colour's emitter covers; ``gap_to_opening``, ``colour_gap``
    and ``min_width`` are the rules of these emitters, the last by default two dots. ``circuit`` is the area of one
    drive circuit, of which the pixel's closed area at least ``min_width`` wide must hold three. Both are as in
    [emitters]. ``keep_out`` is a drawing of the cell, the top row first: x stays closed, . is free.
    """

    min_feature_dots: int = Field(default=1, ge=1)
    min_space_dots: int = Field(default=1, ge=1)
    kissing: Literal["allowed", "cell", "neighbours"] = "allowed"
    rim_dots: int = Field(default=0, ge=0)
    symmetry: Literal["d4", "mirror", "rot180"] | None = None
    footprint: float | None = Field(default=None, gt=0, le=1, allow_inf_nan=False)
    gap_to_opening: LengthOrZero = 0.0
    colour_gap: LengthOrZero = 8.0
    min_width: Length | None = None
    circuit: Area | None = None
    wire_flow: int | None = Field(default=None, ge=1)
    ports: int | None = Field(default=None, ge=1)
    centroid_px: float | None = Field(default=None, gt=0, le=1, allow_inf_nan=False)
    keep_out: str | None = None


class DesignSection(Section):
    """[design]: an opening to be found, by either method.

    ``clear_dots`` and ``rules`` are met exactly by either method. ``output`` is a path relative to the job
    file.
    """

    name: Name
    method: Method = "search"
    dots: int = Field(ge=1, le=128)
    pitch: Pitch
    clear_dots: int = Field(ge=1)
    tiling: Annotated[Tiling, Field(strict=False)] = Tiling.RANDOM
    tiling_seed: int | None = Field(default=None, ge=0)
    seed: int = Field(default=0, ge=0)
    anneal: int = Field(default=0, ge=0, le=10_000_000)
    rules: RulesSection = RulesSection()
    output: str | None = None


class SearchSection(DesignSection):
    """[design] with method "search": compact shapes, by the photographs that could be restored behind them.

    Every shape of the ``families`` is judged by the expected restored PSNR, levels of light by their ``weights``, and
    the best is changed dot by dot for ``anneal`` evaluations. With the ``objective`` "auc" it is the area under the
    radial minimum of the blue MTF instead, and no families are looked at. With ``map`` the orientations of the cells
    round the axis are designed too: with the light of a random map, drawn by ``tiling_seed``, or with cut cells turned
    inward; of the best shapes that differ in family or size, so many as the ``shortlist`` has are tried under a quick
    map, and the best goes on. The opening may then lie at one of so many ``positions`` in its cell, and opening and map
    are bettered in turns for ``joint`` rounds. ``density`` is the share of the dots that are clear in the central half
    of the stop; the rest has so many fewer that the light is the same, and there is no shortlist.
    """

    families: Annotated[
        tuple[Literal["bars", "discs", "l_shapes", "crosses", "blobs"], ...], Field(min_length=1, strict=False)
    ] = ("bars",)
    objective: Literal["restored", "auc"] = "restored"
    weights: Annotated[tuple[float, float, float], Field(strict=False)] = (1.0, 1.0, 1.0)
    map: Literal["equal_light", "edge_packing"] | None = None
    map_output: str | None = None
    shortlist: int = Field(default=4, ge=1, le=100)
    positions: int = Field(default=1, ge=1, le=15)
    joint: int = Field(default=0, ge=0, le=100)
    density: float | None = Field(default=None, gt=0, lt=1, allow_inf_nan=False)


class RelaxSection(DesignSection):
    """[design] with method "relax": gradient descent on relaxed dots, see
    :class:`maskfab.design.relax.descent.Descent`.

    The weighted sum of ``objectives`` is minimised, ``area`` being the pull on the open ratio; or a published
    ``recipe`` is followed, which has its own objectives and schedule. Then ``anneal`` exchanges of dots are tried.
    """

    recipe: Literal["paper-l2", "paper-l2+inv"] | None = None
    epochs: int = Field(default=150, ge=1, le=10_000)
    objectives: Annotated[dict[ObjectiveName, Weight], Field(min_length=1)] = {"invertibility": 1.0}
    epsilon: float = Field(default=0.015, ge=0, le=1, allow_inf_nan=False)
    worst_fraction: float = Field(default=0.3, gt=0, le=1, allow_inf_nan=False)
    normalisation: Literal["light", "own_sum"] = "light"
    iterations: int = Field(default=300, ge=1, le=100_000)
    starts: int = Field(default=1, ge=1, le=1000)
    optimiser: Literal["adam", "sgd"] = "adam"
    rate: float = Field(default=0.2, gt=0, le=1e6, allow_inf_nan=False)
    start_logit: float = Field(default=1.0, ge=-100, le=100, allow_inf_nan=False)
    start_noise: float = Field(default=0.5, ge=0, le=100, allow_inf_nan=False)
    straight_through: bool = False
    patience: int = Field(default=0, ge=0)


def _method(values: object) -> str:
    """Which of the two a [design] is read as; what is no method is refused by either."""
    stated = values.get("method") if isinstance(values, dict) else getattr(values, "method", None)
    return "relax" if stated == "relax" else "search"


AnyDesign = Annotated[
    Annotated[SearchSection, Tag("search")] | Annotated[RelaxSection, Tag("relax")], Discriminator(_method)
]


class ParetoSection(Section):
    """[pareto]: restored photographs against emitters, for several sizes of openings, among the shapes of [design].

    ``clear_dots`` are listed or given as a range; each is a curve. ``compare`` names files of openings, relative to the
    job file, that are judged beside them. With ``anneal``, the opening at each of so many ``points`` of a curve is
    changed dot by dot, for so many evaluations, its footprint kept.
    """

    clear_dots: Counts
    compare: Annotated[tuple[str, ...], Field(max_length=100, strict=False)] = ()
    anneal: int = Field(default=0, ge=0, le=1_000_000)
    points: int = Field(default=4, ge=1, le=100)


class EmittersSection(Section):
    """[emitters]: placement rules of the red, green and blue emitters around the openings of every die.

    Gaps are kept in x or in y, corners included, and across pixels too. ``ratio`` is that of the areas; ``required``
    the least share of the pixel that one colour covers, divided by its ratio (ratios scaled to sum to 3). Of the
    placements with at least ``keep`` of the largest footprint, the one whose light is centred best is taken.
    ``circuit`` is the area of one drive circuit, of which a pixel's closed area must hold ``circuits``; ``shared_by``
    pixels take turns at them.
    """

    gap_to_opening: LengthOrZero = 0.0
    colour_gap: LengthOrZero
    min_width: Length
    ratio: ThreeColours = (1.0, 1.0, 1.0)
    max_aspect: float | None = Field(default=None, ge=1, allow_inf_nan=False)
    required: float = Field(default=0.0, ge=0, le=1, allow_inf_nan=False)
    keep: float = Field(default=1.0, gt=0, le=1, allow_inf_nan=False)
    circuit: Area = 1985.0
    circuits: int = Field(default=3, ge=1, le=16)
    shared_by: int = Field(default=1, ge=1, le=16)


class WiresSection(Section):
    """[wires]: the display's wires.

    ``lines`` is how many must cross every pixel from top to bottom, and from left to right, on two layers of metal;
    opaque ones are ``line`` wide, ``space`` apart and ``clearance`` from openings. A ``transparent`` wire of that width
    runs straight over every pixel in both directions and passes a share ``transmission`` of the light.
    """

    line: Length = 3.0
    space: Length = 3.0
    clearance: LengthOrZero = 2.5
    lines: int = Field(default=4, ge=1, le=64)
    transparent: Length | None = None
    transmission: float = Field(default=0.9, gt=0, le=1, allow_inf_nan=False)


class LightSection(Section):
    """[light]: what the display must emit: white luminance in cd/m2, cd/A of each colour, and how life falls with
    current density, as its power ``-life_exponent``."""

    luminance: float = Field(default=500.0, gt=0, allow_inf_nan=False)
    efficacy: ThreeColours = (45.0, 110.0, 8.0)
    life_exponent: float = Field(default=1.44, gt=0, allow_inf_nan=False)


class SceneSection(Section):
    """[scene]: what the camera looks at and how accurate the PSF must be; the defaults ask for nothing extra.

    ``depth`` is the nearest and the farthest object, ``field`` the largest image height, ``gap`` the distance from the
    panel to the stop; ``aberrations`` are pairs of Noll's number and waves at the first wavelength. ``spectrum`` is the
    camera's own lines, the bundled colour camera, or a file of its response; ``illuminant``, for colours alone, is a
    black body's temperature in kelvins, a file of one curve, or equal energy at all wavelengths. A file is a path
    relative to the job file, or a key of [curves].
    """

    accuracy: Accuracy = 1e-3
    depth: Depth = (math.inf, math.inf)
    focus: Distance = math.inf
    field: LengthOrZero = 0.0
    gap: LengthOrZero = 0.0
    aberrations: Aberrations = ()
    saturation: bool = False
    spectrum: Spectrum = "lines"
    illuminant: Illuminant = "equal"


DRAWING_KEYS = ("hierarchy", "max_vertices", "holes", "corners", "max_references")
"""Keys of [export] that say how polygons are drawn."""


class ExportSection(Section):
    """[export]: the files of a plate, and how their polygons are drawn.

    A die with more than ``max_references`` puts two pixels in each cell; ``dots_per_um`` sets the pixels of PNG and
    TIFF. The format ``exr`` is of the PSFs that are measured in the files before it.

    ``shop`` is a mask shop: its name, or the path of your own profile, relative to the job file. Its rules are checked
    on every GDSII, OASIS, DXF and Gerber file with all its layers; SVG, solids and pictures are for people. Formats and
    drawing options that the job states are honoured and checked. Those it omits are None and default to the shop's: its
    first format, and polygons as ``maskfab package`` would draw them, except that holes never get a layer of their own.
    """

    formats: Formats | None = MASK_FORMATS
    shop: str | None = None
    hierarchy: Literal["cells", "flat", "merged"] | None = "cells"
    max_vertices: int | None = Field(default=4094, ge=4, le=4094)
    holes: Literal["bisect", "keyhole", "trapezoids"] | None = "bisect"
    corners: Literal["apart", "joined"] | None = "apart"
    max_references: int | None = Field(default=None, ge=1)
    dots_per_um: float = Field(default=0.125, gt=0, le=MOST_DOTS_PER_UM, allow_inf_nan=False)
    stl_limit_mb: float = Field(default=100.0, gt=0, le=10_000, allow_inf_nan=False)
    chrome: Length = 0.1
    exaggeration: float = Field(default=1.0, ge=1, le=1e6, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _left_to_the_house(cls, stated: object) -> object:
        """With a shop, what is left out stays open until its profile and the plate are known."""
        if not (isinstance(stated, dict) and stated.get("shop") is not None):
            return stated
        return {**dict.fromkeys(("formats", *DRAWING_KEYS)), **stated}


class ProcessSection(Section):
    """[process]: what the mask writer does to corners and widths; a positive ``cd_bias`` widens what is clear."""

    corner_radius: LengthOrZero = 0.0
    cd_bias: SignedLength = 0.0

    def process(self) -> Process:
        """The process of the model."""
        return Process(self.corner_radius, self.cd_bias)


class JobSpec(Section):
    """A whole job file. ``openings``, ``maps``, ``curves`` and ``shops`` hold files by the names that dies, [scene] and
    [export] use: a job is then self-contained.
    """

    job: JobSection | None = None
    camera: CameraSection
    plate: PlateSection | None = None
    limits: LimitsSection = LimitsSection()
    die: Annotated[tuple[DieSection, ...], Field(strict=False)] = ()
    design: AnyDesign | None = None
    pareto: ParetoSection | None = None
    scene: SceneSection | None = None
    emitters: EmittersSection | None = None
    wires: WiresSection | None = None
    light: LightSection | None = None
    export: ExportSection | None = None
    process: ProcessSection | None = None
    openings: dict[str, str] = {}
    maps: dict[str, str] = {}
    curves: dict[str, str] = {}
    shops: dict[str, str] = {}

    def dump(self) -> dict[str, Any]:
        """Plain data that loads to an equal spec; defaults are written out, so that they are part of the job's hash.

        Left out are ``curves``, ``maps`` and ``shops`` where they are empty, and what [export] leaves to its shop.
        """
        data = self.model_dump(mode="json", exclude_none=True)
        # A job without tables, maps or profiles keeps the hash that it had before jobs could name any.
        return {key: value for key, value in data.items() if value or key not in {"curves", "maps", "shops"}}
