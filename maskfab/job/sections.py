"""The sections of a job file, and the whole of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from maskfab.base.errors import JobError
from maskfab.base.model import Tiling
from maskfab.base.units import NM_PER_UM
from maskfab.job.camera import Camera, Sensor
from maskfab.job.die import DieSection
from maskfab.job.order import DATA_KEYS, OrderSection, Tone
from maskfab.job.process import MaskBlank, Process
from maskfab.job.values import (
    MASK_FORMATS,
    MOST_DOTS_PER_UM,
    NUMBER,
    WORD,
    Aberrations,
    Accuracy,
    Area,
    Counts,
    Depth,
    Distance,
    Dpi,
    DrawnText,
    FieldReach,
    Formats,
    Frequency,
    Illuminant,
    Kissing,
    Length,
    LengthOrZero,
    LensDistortion,
    LensProjection,
    LookedFrom,
    Method,
    Name,
    Names,
    ObjectiveName,
    Pitch,
    PlateLength,
    Section,
    Spectrum,
    Symmetry,
    ThreeColours,
    Tilt,
    Time,
    Weight,
    checks,
    word_or_number,
)


class JobSection(Section):
    """[job]: name and title of the plate."""

    name: Name
    """Name of the plate: a letter, then at most 23 letters, digits or underscores. Files are named after it."""
    title: DrawnText = Field(max_length=80)
    """Text of the title block, ASCII, at most 80 characters."""


@dataclass(frozen=True, kw_only=True)
class PlateSection(MaskBlank):
    """[plate]: the blank and how dies are arranged on it."""

    template: str | None = None
    """A file of export_templates/plates, such as "5in", that states blank, writable area and marks."""
    blank: PlateLength | None = None
    """Side of the blank; required without a template."""
    writable: PlateLength | None = None
    """Side of the area that may be written; required without a template."""
    die_size: PlateLength
    """Side of the square that each die fills."""
    die_pitch: PlateLength
    """Distance between the centres of neighbouring dies."""
    columns: Annotated[int, Field(ge=1, le=100)]
    """Dies in a row."""
    serial: Annotated[DrawnText, Field(min_length=1, max_length=24)] | None = None
    """Serial number of the plate, drawn in its title and told by its report."""

    @property
    def texts(self) -> dict[str, str]:
        """Texts of the title after its maker, by key."""
        return {key: text for key in IN_TITLE if (text := getattr(self, key)) is not None}


IN_TITLE = ("serial",)
"""Keys of [plate] whose text is drawn in the title, behind the key, and told by the report."""


class AssumedPlate(PlateSection):
    """A [plate] that nobody stated: panels of Python have one, so that they can be laid out."""


class LimitsSection(Section):
    """[limits]: limits of every die; quantities without a limit are reported without a verdict."""

    corner_touches: int | None = Field(default=None, ge=0)
    """Most points at which two clear corners may touch."""
    min_feature: Length | None = None
    """Narrowest clear shape."""
    min_space: Length | None = None
    """Narrowest chrome between clear shapes."""


class RulesSection(Section):
    """design.rules: rules of the opening; see :class:`maskfab.designs.rules.constraints.Constraints` for each."""

    min_feature_dots: int = Field(default=1, ge=1)
    """Narrowest clear shape, dots."""
    min_space_dots: int = Field(default=1, ge=1)
    """Narrowest closed space, dots."""
    kissing: Kissing = "allowed"
    """Corners that only touch: allowed, none within a cell, or none between neighbours either."""
    rim_dots: int = Field(default=0, ge=0)
    """Closed dots all round the cell; neighbours meet with twice as many between their openings."""
    symmetry: Symmetry | None = None
    """Symmetry that the opening must have."""
    ports: int | None = Field(default=None, ge=1)
    """Symmetric ports through which so many lines can cross the closed dots of the cell either way, whatever their
    neighbours' orientations."""
    centroid_px: float | None = Field(default=None, gt=0, le=1, allow_inf_nan=False)
    """Largest distance of the light's centroid from the pixel's centre, pixels; of the emitters that ``fit`` places."""
    slow_grain: float | None = Field(default=None, gt=0, le=1, allow_inf_nan=False)
    """Largest slow grain of an even field, rms contrast up to 10 cycles per degree at 300 mm; of the emitters that
    ``fit`` places, pixels turned at random."""
    delta_e: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Largest mean ΔE of an even field with the emitters that ``fit`` places, seen from the distance of [looks]."""
    grain: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Largest rms luminance contrast of that field up to 10 cycles per degree."""
    keep_out: str | None = None
    """Drawing of the cell, top row first: x stays closed, . is free."""


class DesignSection(Section):
    """[design]: an opening to be found, by either method."""

    name: Name
    """Name of the opening."""
    method: Method = "search"
    """"search" over compact shapes, or "relax", gradient descent."""
    dots: int = Field(ge=1, le=128)
    """Dots along a side of the cell."""
    pitch: Pitch
    """Pitch of the pixels, as a length or in DPI."""
    clear_dots: int = Field(ge=1)
    """Number of clear dots; met exactly."""
    tiling: Annotated[Tiling, Field(strict=False)] = Tiling.RANDOM
    """Order of orientations that the opening is designed for."""
    tiling_seed: int | None = Field(default=None, ge=0)
    """Seed of that order."""
    seed: int = Field(default=0, ge=0)
    """Seed of the search."""
    anneal: int = Field(default=0, ge=0, le=10_000_000)
    """Evaluations of a search dot by dot that follows."""
    rules: RulesSection = RulesSection.model_construct()
    """Hard constraints on the opening, a table."""
    output: str | None = None
    """File of the opening, relative to the job."""

    @property
    def drawn_seed(self) -> int:
        """Seed of the tiling that is drawn, and of the random map that a map starts from."""
        return self.seed if self.tiling_seed is None else self.tiling_seed


DensityOrSearch = Annotated[
    Annotated[Literal["search"], Tag(WORD)] | Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False), Tag(NUMBER)],
    Discriminator(word_or_number),
]


class SearchSection(DesignSection):
    """[design] with method "search": compact shapes, by the photographs that could be restored behind them.

    Every shape of the ``families`` is judged by the expected restored PSNR, levels of light by their ``weights``, and
    the best is changed dot by dot for ``anneal`` evaluations. With ``map`` the orientations of the cells round the axis
    are designed too: with the light of a random map, drawn by ``tiling_seed``, or with cut cells turned
    inward; of the best shapes that differ in family or size, so many as the ``shortlist`` has are tried under a quick
    map, and the best goes on. The opening may then lie at one of so many ``positions`` in its cell, and opening and map
    are bettered in turns for ``joint`` rounds. ``density`` is the share of the dots that are clear in the central half
    of the stop; the rest has so many fewer that the light is the same, and there is no shortlist. With ``outer_dots``
    the rest is stated, and the middle as large as the light leaves; with "search" the share is found.
    """

    clear_dots: int = Field(default=0, ge=0)
    """Number of clear dots; met exactly. 0, or left out: chosen among those that the display fits, with fit = true."""
    families: Annotated[
        tuple[Literal["bars", "discs", "l_shapes", "crosses", "blobs"], ...], Field(min_length=1, strict=False)
    ] = ("bars",)
    """Shapes that are tried. Their names tell height x width in dots, the thickness of arms, and (row, column) of the
    lower left dot, or of a disc's centre, from 0 at the pixel's lower left: L 12x22 of 8 at (0, 12)."""
    protocol: Literal["f1", "camera"] | None = None
    """Photographs that openings are compared by: protocol F1's, code values taken for light at 24, 32 and 40 dB, or
    those of the job's own sensor and levels in linear light; default: its own where it has [sensor] or [exposure]."""
    weights: Annotated[tuple[float, ...], Field(min_length=1, max_length=16, strict=False)] | None = None
    """Weights of the levels of light; equal where they are left out."""
    map: Literal["equal_light", "edge_packing"] | None = None
    """Design the orientation of each cell too: at the light of a random map, or with cut cells turned inwards."""
    map_output: str | None = None
    """File of the map, relative to the job."""
    shortlist: int = Field(default=4, ge=1, le=100)
    """Best shapes that are tried under a quick map before one is chosen."""
    positions: int = Field(default=1, ge=1, le=15)
    """Offsets of the opening in its cell that the map may choose from."""
    joint: int = Field(default=0, ge=0, le=100)
    """Rounds that alternate between opening and map."""
    fit: bool = False
    """The display of the job's [emitters] and [wires] must fit, by the checks of ``maskfab check``, on a die too."""
    density: DensityOrSearch | None = None
    """Share of clear dots in the middle of the stop; the rest has fewer, so that total light is the same. "search"
    finds the share that restores best of those whose display fits on any map and keeps the rules."""
    outer_dots: int | None = Field(default=None, ge=1)
    """Clear dots of cells beyond the middle, whose radius follows; default: the middle is half of the stop, and with
    density = "search" as large as the light of 1 to 3 dots beyond it leaves."""

    @checks
    def _counted(self) -> None:
        uneven = [] if self.density is None else ["with density, for two openings"]
        lacking = ["without fit = true", *uneven][self.fit :]
        if self.clear_dots == 0 and lacking:
            what = f"no number of clear dots is chosen {lacking[0]}"
            raise JobError("MF105", what, cure=f"Add clear_dots, at most {self.dots**2}")


class RelaxSection(DesignSection):
    """[design] with method "relax": gradient descent on relaxed dots, see
    :class:`maskfab.designs.descent.schedule.Descent`.

    The weighted sum of ``objectives`` is minimised, ``area`` being the pull on the open ratio; or a published
    ``recipe`` is followed, which has its own objectives and schedule. Then ``anneal`` exchanges of dots are tried.
    """

    recipe: Literal["paper-l2", "paper-l2+inv"] | None = None
    """A published schedule with its own objectives."""
    epochs: int = Field(default=150, ge=1, le=10_000)
    """Epochs of the recipe."""
    objectives: Annotated[dict[ObjectiveName, Weight], Field(min_length=1)] = {"invertibility": 1.0}  # noqa: RUF012  # pydantic copies it
    """Weights of the objectives that are minimised; area is the pull on the open ratio."""
    iterations: int = Field(default=300, ge=1, le=100_000)
    """Steps of the descent."""
    starts: int = Field(default=1, ge=1, le=1000)
    """Noisy starts, of which the best is kept."""


def _method(values: object) -> str:
    """Which of the two a [design] is read as; what is no method is refused by either."""
    stated = values.get("method") if isinstance(values, dict) else getattr(values, "method", None)
    return "relax" if stated == "relax" else "search"


AnyDesign = Annotated[
    Annotated[SearchSection, Tag("search")] | Annotated[RelaxSection, Tag("relax")], Discriminator(_method)
]


class ParetoSection(Section):
    """[pareto]: light, photographs, emitters, wires and grain of designs for the job's display, among the shapes of
    [design]."""

    clear_dots: Counts
    """Numbers of clear dots, listed or as a range; each is a curve."""
    lines: (
        Annotated[tuple[Annotated[int, Field(ge=0, le=64)], ...], Field(min_length=1, max_length=16, strict=False)]
        | None
    ) = None
    """Numbers of lines each way that designs are sought for; default: those of [wires]."""
    compare: Annotated[tuple[str, ...], Field(max_length=100, strict=False)] = ()
    """Files of openings, relative to the job, that are judged beside the curves."""
    anneal: int = Field(default=0, ge=0, le=1_000_000)
    """Evaluations of a search dot by dot at each point, footprint and lines kept."""
    points: int = Field(default=4, ge=1, le=100)
    """Designs of each curve, spread over it, that are annealed, given their map and laid on a die."""
    density: Annotated[tuple[DensityOrSearch, ...], Field(max_length=16, strict=False)] = ()
    """Shares of the dots that are clear in the middle of the stop, as density of [design]: a design for each, at the
    light of each curve. "search" finds ``points`` of them, gain against grain, for the most lines; limits of the eye
    in [design.rules] are drawn and not kept there."""


class EmittersSection(Section):
    """[emitters]: placement rules of the red, green and blue emitters around the openings of every die."""

    gap_to_opening: LengthOrZero = 0.0
    """Least gap from an emitter to any opening, neighbours' included; in x or in y, as all gaps."""
    colour_gap: LengthOrZero
    """Least gap between emitters of two colours, across pixels too."""
    min_width: Length
    """Least width: every emitter is a union of squares of this side."""
    ratio: ThreeColours = (1.0, 1.0, 1.0)
    """Areas of red, green and blue relative to each other."""
    max_aspect: float | None = Field(default=None, ge=1, allow_inf_nan=False)
    """Largest aspect of an emitter that is a rectangle."""
    required: float = Field(default=0.0, ge=0, le=1, allow_inf_nan=False)
    """Least share of the pixel for each colour, divided by its ratio (ratios scaled to sum to 3)."""
    keep: float = Field(default=1.0, gt=0, le=1, allow_inf_nan=False)
    """Share of the largest footprint above which the placement with the best-centred light is chosen."""
    pieces: Literal["one", "several"] | None = None
    """Emitter of a colour: one area (the default), or several that look most alike however pixels are turned."""
    circuit: Area = 1985.0
    """Area of one drive circuit."""
    circuits: int = Field(default=3, ge=1, le=16)
    """Drive circuits that a pixel's closed area must hold."""
    shared_by: int = Field(default=1, ge=1, le=16)
    """Pixels that take turns at one circuit."""

    @property
    def grid_lengths(self) -> dict[str, float]:
        """Lengths that are whole numbers of the cells on which emitters are placed, by their keys, in micrometres."""
        return {key: getattr(self, key) for key in ("gap_to_opening", "colour_gap", "min_width")}


class BoxSection(Section):
    """[[circuits.boxes]]: boxes of one size in a circuit, such as a transistor with its contacts."""

    name: str = Field(min_length=1, max_length=40)
    """Their part of the circuit, in your own words."""
    width: Length
    """One side, contacts included."""
    height: Length
    """The other side."""
    count: int = Field(default=1, ge=1, le=64)
    """Number of them in one circuit."""


class CircuitsSection(Section):
    """[circuits]: boxes of the drive circuits, which are placed in the closed area of every pixel, under the emitters.

    The boxes of 7 transistors and a capacitor are derived, for no published layout was found. BOE BF060Y8M has a
    subpixel of 63 x 31.5 um; two lines of 3 um along it take 378 um^2 of its 1985 um^2, and these boxes with their gaps
    1576 um^2. Their sides are a judgement for a process of lines and spaces of 3 um: pads of 6 um about a channel of 3
    um, a channel of 12 um for the transistor that drives, and 256 um^2 of plates.
    """

    boxes: Annotated[tuple[BoxSection, ...], Field(min_length=1, max_length=16, strict=False)] = (
        BoxSection.model_construct(name="driving transistor", width=24.0, height=6.0),
        BoxSection.model_construct(name="switching transistor", width=15.0, height=6.0, count=6),
        BoxSection.model_construct(name="capacitor", width=16.0, height=16.0),
    )
    """Boxes of one circuit; default: 7 transistors and a capacitor."""
    gap: LengthOrZero = 3.0
    """Least gap between boxes, across pixels too; in x or in y, as all gaps."""
    gap_to_opening: LengthOrZero = 3.0
    """Least gap from a box to any opening, neighbours' included."""
    turnable: bool = True
    """Boxes may also lie on their side."""
    per_pixel: int = Field(default=3, ge=1, le=16)
    """Circuits of one pixel, one for each subpixel."""
    shared_by: int = Field(default=1, ge=1, le=16)
    """Pixels that take turns at one circuit; every pixel then holds so many fewer, rounded up."""

    @checks
    def _no_more_than_sense(self) -> None:
        boxes = -(-self.per_pixel // self.shared_by) * sum(box.count for box in self.boxes)
        if boxes > _MOST_BOXES:
            what = f"{boxes} boxes in a pixel are more than {_MOST_BOXES}"
            raise JobError("MF115", what, cure="Join neighbouring parts of a circuit in one box")


_MOST_BOXES = 256


class DisplaySection(Section):
    """[display]: the pixels over the camera beside those of the display around them.

    Pixels that are left out are told by both pitches: dies whose pixels are two by two of those around leave out three
    of four.
    """

    normal: Pitch | None = None
    """Pitch of the display around, as a length or in DPI; default: that of the dies."""
    sharing: int | None = Field(default=None, ge=1, le=16)
    """Pixels that share their circuits, in place of ``shared_by``; default: that, and ``advise`` chooses."""


class WiresSection(Section):
    """[wires]: the display's wires."""

    line: Length = 3.0
    """Width of an opaque wire."""
    space: Length = 3.0
    """Least space between wires."""
    clearance: LengthOrZero = 2.5
    """Least distance from a wire to an opening."""
    lines: int = Field(default=4, ge=1, le=64)
    """Wires that must cross every pixel from top to bottom, and from left to right, on two layers of metal."""
    transparent: Length | None = None
    """Width of one transparent wire along each axis, straight over every pixel; none if left out."""
    transmission: float = Field(default=0.9, gt=0, le=1, allow_inf_nan=False)
    """Transmission of a transparent wire."""


class LightSection(Section):
    """[light]: light that the display must emit."""

    luminance: float = Field(default=500.0, gt=0, allow_inf_nan=False)
    """Luminance of white, cd/m2."""
    efficacy: ThreeColours = (45.0, 110.0, 8.0)
    """Efficacy of red, green and blue, cd/A."""
    life_exponent: float = Field(default=1.44, gt=0, allow_inf_nan=False)
    """Life falls with current density to this power, negative."""


class LooksSection(Section):
    """[looks]: where the display is looked at, what may be seen of it, and the maker's regular display beside it.

    A limit that is stated is a check. Without, a default is held against the display: it judges the verdict LOOKS and
    which die may be called best, and fails no run.
    """

    distance: LookedFrom = 300_000.0
    """Distance from the eye to the display."""
    dpi: float | None = Field(default=None, ge=10, le=10_000, allow_inf_nan=False)
    """Dots per inch that dies and reference are scaled to where they are looked at; default: their own."""
    delta_e: float | None = Field(default=None, gt=0, le=100, allow_inf_nan=False)
    """Largest mean ΔE (S-CIELAB, CIE 1976) of even white; left out, 2.3, just noticeable, judges the verdict alone."""
    grain: float | None = Field(default=None, gt=0, le=1, allow_inf_nan=False)
    """Largest rms contrast of even white up to 10 cycles per degree; left out, 0.015 judges the verdict alone."""
    fringe: float | None = Field(default=None, gt=0, le=500, allow_inf_nan=False)
    """Largest difference in a* and b* at an edge of black and white; none if left out."""
    reference: Literal["stripe", "pentile", "delta"] = "stripe"
    """Regular layout of the reference display, which has no openings and the die's pitch."""


class LivesSection(Section):
    """[lives]: life and power of the display beside those of the reference display of [looks], at equal luminance.

    Limits are as those of [looks]: stated ones are checks, and a default judges the verdict LIVES.
    """

    life: float | None = Field(default=None, gt=0, le=1000, allow_inf_nan=False)
    """Least life of the shortest-lived colour over the reference's; left out, a third judges the verdict alone."""
    power: float | None = Field(default=None, gt=0, le=1000, allow_inf_nan=False)
    """Most power over the reference's; none if left out."""


class SceneSection(Section):
    """[scene]: what the camera looks at and how accurate the PSF must be; the defaults ask for nothing extra.

    A ``design`` that searches is for the mean over what its accuracy asks to be modelled of depth, focus, field, gap
    and aberrations; it does not use the other keys. A file is a path relative to the job file, or a key of [curves].
    """

    accuracy: Accuracy = 1e-3
    """Largest relative L2 error of the PSF: "draft" 1e-2, "standard" 1e-3, "certify" 1e-6, or a number."""
    depth: Depth = (math.inf, math.inf)
    """Nearest and farthest object."""
    focus: Distance = math.inf
    """Distance of the object that is in focus."""
    field: FieldReach = 0.0
    """Largest image height, or angle off the axis such as "20 deg"."""
    projection: LensProjection = "f tan"
    """Image height over the angle off the axis: "f tan", "f theta", or a file of rows angle_deg,height_um."""
    tilt: Tilt = 0.0
    """Angle of the panel about y, such as "3 deg", its +x side away from the lens."""
    gap: LengthOrZero = 0.0
    """Distance from the panel to the stop."""
    aberrations: Aberrations = ()
    """Pairs of Noll's number and waves at the first wavelength."""
    distortion: LensDistortion | None = None
    """Relative displacement of the image at a height, positive for a pincushion: { ratio = 0.02, height = "2 mm" }."""
    saturation: bool = False
    """Highlights clip at the sensor; left to the capture, adds nothing to the PSF."""
    spectrum: Spectrum = "lines"
    """"lines" of the camera, "rgb", a generic colour camera, or the path of a response."""
    illuminant: Illuminant = "equal"
    """Light on the scene, for colours: "equal" energy, a black body such as "6500 K", or a file of one curve."""

    @checks
    def _one_mapping(self) -> None:
        if self.distortion is not None and self.projection != "f tan":
            what = f"a distortion, which follows f tan, of a lens whose projection is {self.projection!r}"
            cure = "Put the distortion into the projection's table, or remove scene.distortion"
            raise JobError("MF105", what, cure=cure)


class ExposureSection(Section):
    """[exposure]: light of white, stated in one of three ways; without any photographs are taken at 24, 32 and 40 dB,
    the highest lowered to what the sensor's full well holds.

    Levels and electrons are those behind the published display, which passes 20.72 % of the stop's light: behind every
    die there are as many more as it lets through. A gain that [sensor] leaves out follows from them.
    """

    snr: Annotated[tuple[float, ...], Field(min_length=1, max_length=16, strict=False)] | None = None
    """Signal-to-noise ratios of white behind the published display, dB."""
    white: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Electrons of white behind the published display."""
    luminance: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Luminance of white in the scene, cd/m2; needs time and quantum_efficiency."""
    time: Time | None = None
    """Exposure time."""
    quantum_efficiency: float | None = Field(default=None, gt=0, le=1, allow_inf_nan=False)
    """Electrons for each photon."""
    brackets: Annotated[tuple[float, ...], Field(min_length=1, max_length=8, strict=False)] | None = None
    """Exposures of every scene that photographs merge: times by which their light is less, such as [1, 4, 16]."""

    @checks
    def _one_way(self) -> None:
        given = [key for key in _SCENE_LIGHT if getattr(self, key) is not None]
        ways = [key for key in ("snr", "white") if getattr(self, key) is not None] + given[:1]
        if len(ways) > 1 or not (ways or self.brackets) or len(given) not in (0, len(_SCENE_LIGHT)):
            stated = ", ".join(key for key in ("snr", "white", *_SCENE_LIGHT) if getattr(self, key) is not None)
            what = f"the exposure states {stated or 'nothing'}"
            raise JobError("MF105", what, cure=f"Give snr, or white, or {', '.join(_SCENE_LIGHT)} together")


_SCENE_LIGHT = ("luminance", "time", "quantum_efficiency")

DRAWING_KEYS = ("hierarchy", "max_vertices", "holes", "corners", "max_references")
"""Keys of [export] that say how polygons are drawn."""


class ExportSection(Section):
    """[export]: the files of a plate, and how their polygons are drawn.

    Formats and drawing options that the job states are honoured and checked against the shop's rules. Those it omits
    are None with a shop and default to the shop's: its first format, and polygons as ``maskfab order pack`` would draw
    them, except that holes never get a layer of their own. The format ``exr`` is of the PSFs that are measured in the
    files before it.
    """

    formats: Formats | None = MASK_FORMATS
    """File formats; the first four if left out."""
    shop: str | None = None
    """A mask shop: its name, or the path of your own profile. Its rules are checked on every mask file."""
    hierarchy: Literal["cells", "flat", "merged"] | None = "cells"
    """Cells placed by reference, flat polygons, or polygons merged across pixels."""
    max_vertices: int | None = Field(default=4094, ge=4, le=4094)
    """Most vertices of a polygon."""
    holes: Literal["bisect", "keyhole", "trapezoids"] | None = "bisect"
    """Way in which outlines with holes are written."""
    corners: Literal["apart", "joined"] | None = "apart"
    """Dots that touch at a corner: apart, or joined in one outline."""
    max_references: int | None = Field(default=None, ge=1)
    """References of a die above which two pixels share a cell."""
    grid: Length | None = None
    """Grid of the data: dies off it are refused, marks are moved to it; default: 1 nm, or the shop's."""
    dots_per_um: float = Field(default=0.125, gt=0, le=MOST_DOTS_PER_UM, allow_inf_nan=False)
    """Pixels per micrometre of PNG and TIFF."""
    dpi: Dpi | None = None
    """Dots per inch of the plotter, for plate_tiff and plate_bmp; default: the finest that the shop states."""
    stl_limit_mb: float = Field(default=100.0, gt=0, le=10_000, allow_inf_nan=False)
    """Largest STL, MB."""
    chrome: Length = 0.1
    """Thickness of the film in solids."""
    exaggeration: float = Field(default=1.0, ge=1, le=1e6, allow_inf_nan=False)
    """Factor on that thickness, to make it visible."""

    @model_validator(mode="before")
    @classmethod
    def _left_to_the_house(cls, stated: object) -> object:
        """With a shop, what is left out stays open until its profile and the plate are known."""
        if not (isinstance(stated, dict) and stated.get("shop") is not None):
            return stated
        return {**dict.fromkeys(("formats", *DRAWING_KEYS)), **stated}


class CaseSection(Section):
    """[[study.case]]: one state of the scene that a study takes photographs in."""

    name: str = Field(min_length=1, max_length=40)
    """Name of the case in tables and figures."""
    scene: dict[str, Any] = Field(default_factory=dict)
    """Keys of [scene] in place of the job's."""
    brackets: Annotated[tuple[float, ...], Field(min_length=1, max_length=8, strict=False)] | None = None
    """Exposures in place of exposure.brackets; a study with any draws lamps, and leaves out photographs without light
    above white."""
    restored_by: str | None = None
    """Case whose blur restorers take the photographs' for; default: its own, on the axis."""


class ClaimSection(Section):
    """[[study.claim]]: a sentence that a study's numbers agree with or not.

    The number is that of ``die``, less that of ``over``; photograph by photograph where it is a score. A claim holds
    for every protocol, level, case and restorer of the study unless it names some. It agrees where the whole 95 %
    interval lies within the limits, does not where all of it lies outside, and cannot be told otherwise.
    """

    says: str = Field(min_length=1, max_length=400)
    """The claim, in your own words."""
    measure: Literal["psnr", "psnr_inner", "ssim", "delta_e", "auc_radial_min", "open_ratio", "psf_difference"] = "psnr"
    """Number that is compared: a mean score of restored photographs, one of the optics, or the relative difference of
    two PSFs."""
    die: Names
    """Die that the claim is about, or several."""
    over: Names | None = None
    """Die that it is compared with; one for all, or one for each."""
    levels: Annotated[tuple[float, ...], Field(min_length=1, strict=False)] | None = None
    """Levels of light that it is about, dB."""
    averaged: bool = False
    """Whether the number is the mean of a photograph's scores over the levels; otherwise every level is judged."""
    protocols: Annotated[tuple[str, ...], Field(min_length=1, strict=False)] | None = None
    """Protocols that it is about."""
    case: str | None = None
    """Case that it is about."""
    over_case: str | None = None
    """Case that it is compared with."""
    restorer: str | None = None
    """Restorer that it is about."""
    over_restorer: str | None = None
    """Restorer that it is compared with."""
    at_least: float | None = Field(default=None, allow_inf_nan=False)
    """Least number that agrees."""
    at_most: float | None = Field(default=None, allow_inf_nan=False)
    """Largest number that agrees."""
    why: str = Field(default="", max_length=600)
    """Why it does not agree, shown where it does not."""


class StudySection(Section):
    """[study]: a figure made of the job's dies by ``maskfab study``, and claims that are held against its numbers."""

    figure: str = Field(min_length=1, max_length=60)
    """Figure that it remakes, or a short name of your own."""
    title: str = Field(min_length=1, max_length=120)
    """Heading of its page."""
    about: str = Field(default="", max_length=1500)
    """Its content, in a few sentences."""
    optics: bool = False
    """PSF, autocorrelation and radial-minimum MTF of every die."""
    protocols: Annotated[tuple[Literal["camera", "f1", "paper"], ...], Field(strict=False)] = ()
    """Protocols that photographs are taken by; none for a study without photographs."""
    levels: Annotated[tuple[float, ...], Field(min_length=1, max_length=16, strict=False)] | None = None
    """Levels of light, dB; default: those of the protocol or of [exposure]."""
    restore: Annotated[tuple[str, ...], Field(min_length=1, strict=False)] | None = None
    """Restorers, as ``maskfab simulate --restore`` names them; protocol paper has its own."""
    scenes: int = Field(default=4, ge=0, le=30)
    """Drawn scenes, beside the photographs of --images."""
    axis: Literal["level", "dpi", "restorer", "case"] = "level"
    """Axis of the figure of scores; along "dpi", dies of one opening and tiling are one curve."""
    case: Annotated[tuple[CaseSection, ...], Field(max_length=16, strict=False)] = ()
    """States of the scene; default: the job's own."""
    claim: Annotated[tuple[ClaimSection, ...], Field(max_length=40, strict=False)] = ()
    """Claims."""


class ReportSection(Section):
    """[report]: what dies are compared by. The data do not depend on it, nor does the hash on the plate."""

    reference: Name | None = None
    """Die that gains of restored photographs are over; default: the first that can be photographed."""
    frequencies: Annotated[tuple[Frequency, ...], Field(min_length=1, max_length=3, strict=False)] | None = None
    """Up to three frequencies on the sensor at which the MTF in its worst direction is told, at most half a cycle per
    pixel; default: a tenth, a quarter and half of that."""


class SpreadSection(Section):
    """[process.spread]: standard deviations over the displays that are made; a design is appraised over them, and the
    numbers of a report get bands of bias and radius."""

    bias: Length | None = None
    """Of the width of clear features."""
    radius: Length | None = None
    """Of the radius to which corners are rounded; a ``design`` does not use it."""
    centre: Length | None = None
    """Of the stop's centre from the orientation map's, along x and along y."""


@dataclass(frozen=True)
class ProcessSection(Process):
    """[process]: what the mask writer does to corners, widths and edges."""

    spread: SpreadSection | None = None


class JobSpec(Section):
    """A whole job file."""

    maskfab: str | None = None
    """Least version of maskfab that the job is for, such as "0.2"; an earlier one refuses it."""
    job: JobSection | None = None
    camera: Camera
    plate: PlateSection | None = None
    limits: LimitsSection = LimitsSection.model_construct()
    die: Annotated[tuple[DieSection, ...], Field(strict=False)] = ()
    design: AnyDesign | None = None
    pareto: ParetoSection | None = None
    scene: SceneSection | None = None
    emitters: EmittersSection | None = None
    circuits: CircuitsSection | None = None
    display: DisplaySection | None = None
    wires: WiresSection | None = None
    light: LightSection | None = None
    looks: LooksSection | None = None
    lives: LivesSection | None = None
    sensor: Sensor | None = None
    exposure: ExposureSection | None = None
    export: ExportSection | None = None
    order: OrderSection | None = None
    process: ProcessSection | None = None
    report: ReportSection | None = None
    study: StudySection | None = None
    openings: dict[str, str] = Field(default_factory=dict)
    """Openings as text, by the names that dies use: a job is then self-contained."""
    maps: dict[str, str] = Field(default_factory=dict)
    """Orientation maps as text, by the names that dies use."""
    curves: dict[str, str] = Field(default_factory=dict)
    """Spectral tables as text, by the names that [scene] uses."""
    shops: dict[str, str] = Field(default_factory=dict)
    """Profiles of mask shops as text, by the names that [export] uses."""

    def dump(self) -> dict[str, Any]:
        """Plain data that loads to an equal spec; defaults are written out, so that they are part of the job's hash.

        Left out are ``curves``, ``maps`` and ``shops`` where they are empty, what [export] leaves to its shop, and the
        version that the job is for.
        """
        data = self.model_dump(mode="json", exclude_none=True)
        # A job without tables, maps or profiles keeps the hash that it had before jobs could name any.
        kept = {key: value for key, value in data.items() if value or key not in {"curves", "maps", "shops"}}
        kept.pop("maskfab", None)
        return kept

    @property
    def sharing(self) -> int:
        """Pixels that share a circuit: by [display], else by [circuits] or [emitters]."""
        stated = None if self.display is None else self.display.sharing
        return stated or max((held.shared_by for held in (self.circuits, self.emitters) if held is not None), default=1)

    @property
    def chooses_sharing(self) -> bool:
        """Whether pixels to a circuit are chosen: [display] leaves them out, and no other key says them."""
        return self.display is not None and self.display.sharing is None and self.sharing == 1

    @property
    def tone(self) -> Tone:
        """Tone of the data; a house's profile has no say in what is drawn."""
        return "clear" if self.order is None or self.order.tone is None else self.order.tone

    @property
    def mirrored(self) -> bool:
        """Whether the data are the mirror image of the design; see :class:`maskfab.job.order.OrderSection`."""
        return self.order is not None and self.order.mirrored

    @property
    def frequencies_cy_per_mm(self) -> tuple[float, ...]:
        """At which the MTF in its worst direction is told."""
        highest = self.camera.nyquist_cy_per_mm
        asked = None if self.report is None else self.report.frequencies
        return asked or tuple(share * highest for share in (0.1, 0.25, 0.5))

    @property
    def written(self) -> Process | None:
        """The process as the finished plate shows it, without a bias that the house or the data make good; or None."""
        if self.process is None:
            return None
        made_good = self.order is not None and self.order.bias in ("house", "data")
        bias_um = 0.0 if made_good else self.process.cd_bias_um
        return Process(self.process.corner_radius_um, bias_um, self.process.roughness)

    @property
    def data_bias_nm(self) -> int | None:
        """Bias that the data make good: how much narrower their clear widths are than the plate's; or None."""
        if self.order is None or self.order.bias != "data" or self.process is None:
            return None
        return round(self.process.cd_bias_um * NM_PER_UM)

    def drawn(self) -> dict[str, Any]:
        """Content of the job's hash: :meth:`dump` without what [order] says on paper alone, and without [report].

        The plate carries the hash in its marks, and an address or a purchase number must not change them.
        """
        data = self.dump()
        data.pop("report", None)
        biased = ("bias", "data")
        stated = data.pop("order", {}).items()
        order = {key: value for key, value in stated if key in DATA_KEYS or (key, value) == biased}
        return {**data, "order": order} if order else data
