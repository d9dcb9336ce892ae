"""An opening, and its map, as a job's [design] asks for them, by the method that it names."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from maskfab.base.arrays import Mask
from maskfab.base.cell_size import CellSize
from maskfab.base.errors import JobError, OpeningError, OutputError
from maskfab.base.extras import require
from maskfab.base.model import Panel, Tiling
from maskfab.base.processes import ALONE, SerialExecutor
from maskfab.base.units import NM_PER_UM, to_nm
from maskfab.base.work import NO_END, Clock, Progress, silent
from maskfab.camera import scenes as scene_sets
from maskfab.camera.protocol import Protocol
from maskfab.camera.scenes import Folder, folder
from maskfab.camera.sensor import stated_light
from maskfab.camera.stop_cells import PhotoCamera, lattice
from maskfab.designs.maps.shares import require_outer
from maskfab.designs.model.appraisal import EXACT, SceneConditions, Spread
from maskfab.designs.model.statistics import F1_SETTINGS, CaptureSettings
from maskfab.designs.rules.constraints import Constraints
from maskfab.designs.rules.display_fit import Display, footprints_of
from maskfab.designs.rules.families import FAMILIES, Candidate
from maskfab.designs.search.result import Designed, constraints_of
from maskfab.display.feasibility import rules_of
from maskfab.job.camera import Sensor
from maskfab.job.faults import JobFaults, parse_section
from maskfab.job.process import UNSTATED
from maskfab.job.reference import USES, Keys, unused
from maskfab.job.sections import (
    DesignSection,
    DisplaySection,
    JobSpec,
    RelaxSection,
    SceneSection,
    SearchSection,
    WiresSection,
)
from maskfab.mask.opening_file import dot_of_pitch
from maskfab.optics.scene.scene import Scene

if TYPE_CHECKING:
    from maskfab.designs.search.annealing import ExpectedPsnr
    from maskfab.designs.search.share import ShareCurve

_SCENES_OF_MAPS = 16
_SHARE_PART = 0.4
"""Of the time of a design whose share of the pixel is to be chosen."""
_DIE_STOPS = 2.1
"""Side of a die over the stop's diameter, where no plate states one: as on ``layouts/upc12.toml``, 8.4 mm before a stop
of 4 mm."""
_MOST_ACROSS = 100
"""Pixels along a side of such a die at most: the check of 100 x 100 takes seconds."""
_OF_DISPLAYS = ("emitters", "circuits", "wires")
_F1S_OWN = ("sensor", "exposure")
"""Sections of a job that say how photographs are taken, in whose place protocol F1 has its own."""
_NOT_DESIGNED_FOR = ("spectrum", "illuminant", "distortion", "saturation", "projection", "tilt")
"""Keys of [scene] that openings are not compared by, and that are set aside before its plan."""


def capture_settings(spec: JobSpec) -> CaptureSettings:
    """The photographs that a job's openings are compared by: its own where it states a sensor or its light.

    Raises:
        JobError: MF140, MF141 for a sensor or a light that cannot be.
    """
    section = spec.design
    named = section.protocol if isinstance(section, SearchSection) else "f1"
    if named == "f1" or (named is None and all(getattr(spec, name) is None for name in _F1S_OWN)):
        return F1_SETTINGS
    sensor = spec.sensor or Sensor()
    levels, _ = stated_light(spec.exposure, sensor, spec.camera)
    return CaptureSettings(Protocol("camera", sensor), levels)


def notes_of(
    spec: JobSpec,
    scenes: Folder,
    uses: Keys,
    settings: CaptureSettings = F1_SETTINGS,
    seen: SceneConditions | None = None,
) -> tuple[str, ...]:
    """Sentences on what a search leaves out of a job, and of the folder of its photographs."""
    if settings.is_f1:
        light = "Openings are compared in the light of protocol F1, code values taken for light"
        named = isinstance(spec.design, SearchSection) and spec.design.protocol == "camera"
        idle = ["protocol of [design]"] if named else []
    else:
        light, idle = "Openings are compared by the job's camera, sensor and light", []
        uses += USES["design by its own light"]
        uses += ("sensor.full_well",) if settings.protocol.sensor.amplifies else ()
    uses += () if seen is None else USES["design for a scene"]
    idle += unused(spec, *uses)
    notes = [f"{light}; not used of the job: {', '.join(idle)}."] if idle else []
    notes += [] if seen is None else [f"Of the scene, {sentence}." for sentence in seen.neglected]
    if scenes.skipped:
        notes.append(f"Skipped, as no photographs: {', '.join(scenes.skipped)}.")
    return tuple(notes)


def display_notes(spec: JobSpec) -> tuple[str, ...]:
    """Sentence on the display of a job that its opening need not fit."""
    unfitted = [f"[{name}]" for name in _OF_DISPLAYS if getattr(spec, name) is not None]
    if not unfitted or getattr(spec.design, "fit", False):
        return ()
    return (f"The opening need not fit {', '.join(unfitted)}, for [design] does not say fit = true.",)


def check_possible(spec: JobSpec, *, where: str) -> None:
    """Refuse rules that no opening keeps, and a camera that no search knows, before anything is read or drawn; all at
    once.

    Raises:
        JobError: MF105 without a [design]; MF123 for rules that contradict each other; MF133 to MF135 for the camera;
            MF140, MF141 for its sensor and its light.
    """
    _possible(spec, where)


def _possible(spec: JobSpec, where: str) -> tuple[Display | None, SceneConditions | None]:
    spec = _assumed(spec)
    section, faults = section_of(spec, where), JobFaults.of_spec(spec)
    display = rules = camera = seen = None
    with faults:
        display = display_of(spec, where)
    with faults:
        rules = constraints_of(section, where=f"{where}: design", display=display)
        fewer = display is not None and isinstance(section, SearchSection) and section.map is not None
        if not fewer or (conflict := rules.conflict()) is None or "clear_dots" not in conflict.rules:
            # Where fewer dots may do, their number is searched.
            rules.require_possible()
    if isinstance(section, SearchSection):
        with faults:
            require_weights(section, capture_settings(spec), where)
        with faults:
            camera = PhotoCamera.of(spec.camera, where=where)
        with faults:
            spread_of(spec, where)
        if rules is not None:
            with faults:
                _check_shapes(spec, section, rules, where)
            if camera is not None:
                from maskfab.designs.search.question import room_of

                with faults:
                    room_of(section, rules, camera, where=f"{where}: design.dots")
        if rules is not None and not faults:
            with faults:
                seen = conditions_of(spec, section, rules.dot_nm, where)
    faults.refuse()
    return display, seen


def _assumed(spec: JobSpec) -> JobSpec:
    """The job with the least share that is looked at, and the most pixels to a circuit, where these are chosen."""
    section = spec.design
    if section is None or section.clear_dots:
        return spec
    from maskfab.designs.search.share import SHARINGS, counts_of

    least = spec.model_copy(update={"design": section.model_copy(update={"clear_dots": min(counts_of(section.dots))})})
    return sharing_by(least, SHARINGS[-1]) if spec.chooses_sharing else least


def share_curve_of(
    spec: JobSpec,
    *,
    where: str,
    images: Path | None = None,
    over: Panel | None = None,
    coarser: bool = False,
    clock: Clock = NO_END,
    executor: SerialExecutor = ALONE,
    progress: Progress = silent,
) -> ShareCurve:
    """Shares of the pixel, and pixels that share a circuit where [display] leaves them out.

    Args:
        over: panel that gains of the curve are over, by the mean over random tilings unless its cells lie alike; by
            default its smallest share.
        coarser: whether three of four pixels may be left out where [display] leaves sharing out and none are left out.

    Raises:
        JobError: as :func:`check_possible`.
    """
    from maskfab.designs.search.question import Judges
    from maskfab.designs.search.share import SHARINGS, Zone, share_curve

    section, settings = section_of(_assumed(spec), where), capture_settings(spec)
    assert isinstance(section, SearchSection)
    camera, scenes = PhotoCamera.of(spec.camera, where=where), scenes_of(images, section)
    dot_nm = dot_of_pitch(section.pitch, section.dots, where=f"{where}: design.pitch")

    def expected(dots: int, of_nm: int) -> ExpectedPsnr:
        return Judges(section, scenes.photographs, lattice(dots, of_nm, camera=camera), settings).expected

    def zone(held: Sequence[JobSpec], across: int) -> Zone:
        own = held[0].design
        assert isinstance(own, SearchSection)
        displays = tuple(stated_display(one, own, where, key="design.fit") for one in held)
        return Zone(displays, own, expected(own.dots, dot_nm * across), across)

    counted = spec.model_copy(update={"design": section})
    free = spec.chooses_sharing
    zones = [zone([sharing_by(counted, sharing) for sharing in SHARINGS] if free else [counted], 1)]
    if free and coarser and zones[0].displays[0].rules.zone.across(dot_nm * section.dots) == 1:
        with suppress(JobError):  # dots may be too coarse for the camera, and lines too many
            zones.append(zone([_left_out(counted)], 2))
    usual = None
    if over is not None:
        alike = over.tiling in (Tiling.PERIODIC, Tiling.HEXAGONAL)
        usual = replace(expected(over.opening.dots, over.dot_nm), periodic=alike)(over.opening.mask)
    stated = 0 if spec.design is None else spec.design.clear_dots
    return share_curve(zones, stated=stated, over=usual, clock=clock, executor=executor, progress=progress)


def with_choice(spec: JobSpec, curve: ShareCurve, where: str) -> JobSpec:
    """The job with the clear dots that a curve chooses, and with the pixels that share a circuit where [display] leaves
    them out; where no display fits any share, with those that are stated or the least, and the most that may share.

    Where pixels are left out, those of the job are twice as wide, and twice as many lines pass them.
    """
    from maskfab.designs.search.share import SHARINGS

    section, best = section_of(_assumed(spec), where), curve.best
    dots = section.clear_dots if best is None else best.clear_dots
    counted = spec.model_copy(update={"design": section.model_copy(update={"clear_dots": dots})})
    if not spec.chooses_sharing:
        return counted
    if best is not None and best.across > 1:
        return _left_out(counted)
    return sharing_by(counted, SHARINGS[-1] if best is None else best.sharing)


def _choice_notes(spec: JobSpec, curve: ShareCurve | None, free: bool) -> tuple[str, ...]:
    """Sentences on a share that was chosen, and on pixels to a circuit that the job must state from now on."""
    if curve is None:
        return ()
    held = f"Set sharing = {spec.sharing} in [display], which the opening is for, before check and run."
    return (curve.told, *((held,) if free and spec.sharing > 1 else ()))


def sharing_by(spec: JobSpec, sharing: int) -> JobSpec:
    """The job with so many pixels to a circuit."""
    stated = spec.display or DisplaySection()
    return spec.model_copy(update={"display": stated.model_copy(update={"sharing": sharing})})


def _left_out(spec: JobSpec) -> JobSpec:
    """The job with three of four pixels left out: those of the zone twice as wide, passed by the lines of two."""
    display, section, wires = spec.display or DisplaySection(), spec.design, spec.wires
    assert section is not None
    if wires is not None:
        parse_section(WiresSection, {"lines": 2 * wires.lines}, where="wires")
    parts = {
        "design": section.model_copy(update={"pitch": 2 * section.pitch}),
        "wires": wires and wires.model_copy(update={"lines": 2 * wires.lines}),
        "display": display.model_copy(update={"sharing": 1, "normal": display.normal or section.pitch}),
    }
    return spec.model_copy(update=parts)


def _check_shapes(spec: JobSpec, section: SearchSection, rules: Constraints, where: str) -> None:
    """Refuse shapes that leave no room for emitters, or of which none keeps the rules (MF104, MF123)."""
    from maskfab.designs.search.scan import require_shapes

    if section.fit and spec.emitters is not None:
        require_room(section, spec.emitters.required, where=f"{where}: design")
        require_cap(section, rules, where=f"{where}: design")
    require_shapes(section, rules)


def conditions_of(spec: JobSpec, section: SearchSection, dot_nm: int, where: str) -> SceneConditions | None:
    """Conditions of the job's scene; None without one, and where a search is by protocol F1 by name.

    Raises:
        JobError: MF104, MF114, MF115 for a scene that cannot be modelled; MF134 for other than three wavelengths;
            MF302 and others for the glass of the plate.
    """
    if spec.scene is None or section.protocol == "f1":
        return None
    from maskfab.designs.search.scan import first_shape

    defaults = {key: SceneSection.model_fields[key].default for key in _NOT_DESIGNED_FOR}
    camera, blank = spec.camera, UNSTATED if spec.plate is None else spec.plate.mask_blank
    scene = Scene.of(spec.scene.model_copy(update=defaults), camera=camera, where=where).through(blank)
    room = lattice(section.dots, dot_nm, camera=PhotoCamera.of(camera, where=where), where=f"{where}: design.dots")
    try:
        return SceneConditions.planned(camera, scene, spec.scene.accuracy, first_shape(section), room)
    except JobError as refusal:
        what = refusal.what
        raise JobError(refusal.code, what, where=f"{where}: {refusal.where or 'scene'}", cure=refusal.cure) from None


def design(
    spec: JobSpec,
    command: str,
    *,
    where: str,
    images: Path | None = None,
    progress: Progress = silent,
    clock: Clock = NO_END,
    checkpoint: Path | None = None,
    price_rules: bool = False,
    begin: Mask | None = None,
    executor: SerialExecutor = ALONE,
) -> Designed:
    """Find the opening of the job's [design], and its map where one is asked for.

    Args:
        images: folder of photographs to design for; synthetic scenes if None.
        checkpoint: file that saves the state of the search, from which it goes on if it exists.
        price_rules: search once more without each rule, beyond the budget.
        begin: opening that the search or the descent begins at, bool [dots, dots].

    Raises:
        JobError: as :func:`check_possible`; MF105 for a search of several openings that is to begin at one;
            MF152 without torch.
        OutputError: MF401 for a checkpoint in a directory that does not exist.
        SourceError: for photographs that cannot be read.
    """
    display, seen, source = require_able(spec, where, images, checkpoint, begin)
    curve, free = None, spec.chooses_sharing
    if section_of(spec, where).clear_dots == 0:
        curve = share_curve_of(
            spec, where=where, images=images, clock=clock.part(_SHARE_PART), executor=executor, progress=progress
        )
        spec = with_choice(spec, curve, where)
        if curve.best is None:
            what = "no display was found to fit an opening of any share of the pixel"
            cure = "State clear_dots to hear what does not fit; ask for smaller circuits, fewer lines or less emitters"
            raise JobError("MF123", what, where=f"{where}: design.fit", cure=cure)
        display, seen, source = require_able(spec, where, images, checkpoint, begin)
    section, camera, settings, scenes = section_of(spec, where), spec.camera, capture_settings(spec), source.photographs
    if isinstance(section, RelaxSection):
        from maskfab.designs.descent.relax import relax

        designed = relax(section, camera, scenes, command, progress, clock=clock, checkpoint=checkpoint, begin=begin)
    else:
        from maskfab.designs.search.question import Question
        from maskfab.designs.search.search import search

        assert isinstance(section, SearchSection)
        needed = seen is not None and seen.needed
        question = Question(
            section,
            scenes,
            command,
            progress,
            camera=PhotoCamera.of(camera),
            settings=settings,
            display=display,
            spread=spread_of(spec, where),
            seen=seen if needed else None,
            clock=clock,
            checkpoint=checkpoint,
            price_rules=price_rules,
            begin=begin,
            executor=executor,
        )
        try:
            designed = search(question)
        except JobError as refusal:
            best = None if curve is None else curve.best
            if best is None or begin is not None or any(fault.code != "MF123" for fault in refusal.faults):
                raise
            # Its best opening may fit no die where the one that the share was chosen by does.
            designed = replace(search(replace(question, begin=best.unit)), shape=best.shape)
    spread = designed.robust is not None
    uses = (
        USES["design"]
        + (USES["design that fits"] if display is not None else ())
        + (USES["design over a spread"] if spread else ())
        + (() if curve is None else USES["design of a chosen share"])
    )
    notes = (
        *designed.notes,
        *_choice_notes(spec, curve, free),
        *notes_of(spec, source, uses, settings, seen),
        *display_notes(spec),
    )
    if price_rules and (designed.account is None or designed.account.without is None):
        notes += ("No search without a rule was made: that takes rules, and annealing for restored photographs.",)
    if not spread and spread_of(spec, where) != EXACT:
        notes += ("A descent and a short budget are not appraised over [process.spread].",)
    account = designed.account
    if account is not None:
        account = replace(account, budget_s=clock.budget_s, scenes=scenes_line(source, images))
    return replace(designed, notes=notes, account=account)


def require_able(
    spec: JobSpec, where: str, images: Path | None, checkpoint: Path | None, begin: Mask | None
) -> tuple[Display | None, SceneConditions | None, Folder]:
    """Refuse all that :func:`design` refuses before its work; arguments as there. Returns the display that must fit,
    the conditions of the scene, and the photographs to design for."""
    require("design", what="a design", where=f"{where}: design")
    display, seen = _possible(spec, where)
    if checkpoint is not None and not os.path.isdir(checkpoint.absolute().parent):
        what = f"there is no directory for the checkpoint {checkpoint}"
        raise OutputError("MF401", what, cure="Create that directory, or give a path in one that exists")
    section = section_of(spec, where)
    if begin is not None and begin.shape != (section.dots, section.dots):
        what = f"the start has {begin.shape[1]} x {begin.shape[0]} dots, and the design {section.dots} along a side"
        raise JobError(
            "MF105", what, where=f"{where}: start", cure=f"Give a start of {section.dots} x {section.dots} dots"
        )
    if begin is not None and isinstance(section, SearchSection) and section.density is not None:
        what = "a search with density begins at no single opening"
        raise JobError("MF105", what, where=f"{where}: start", cure="Leave out density, or start")
    return display, seen, scenes_of(images, section)


def display_of(spec: JobSpec, where: str) -> Display | None:
    """The display that the opening of a job must hold, on a die of its plate or a usual one; None if none must.

    Raises:
        JobError: MF105 if one must and there are no [emitters]; MF106, MF107 for the pitch; MF107, MF116 for the
            display's rules; MF133 to MF135 for a camera that no search knows.
    """
    section = section_of(spec, where)
    if not isinstance(section, SearchSection) or not section.fit:
        return None
    return stated_display(spec, section, where, key="design.fit")


def stated_display(spec: JobSpec, section: SearchSection, where: str, *, key: str) -> Display:
    """The display of a job, whether or not its [design] must fit it, on a die of its plate or a usual one."""
    if spec.emitters is None:
        cure = f"Add [emitters], and [wires] if they must be wired, or remove {key}"
        raise JobError("MF105", "the job has no display that its opening could fit", where=f"{where}: {key}", cure=cure)
    dot_nm = dot_of_pitch(section.pitch, section.dots, where=f"{where}: design.pitch")
    pitch_nm = CellSize(section.dots, dot_nm).pitch_nm
    camera = PhotoCamera.of(spec.camera, where=where)
    before = lattice(section.dots, dot_nm, camera=camera, where=f"{where}: design.dots").cells
    if spec.plate is None:
        side_um = _DIE_STOPS * spec.camera.stop.diameter_um
        across = min(int(side_um * NM_PER_UM / pitch_nm), _MOST_ACROSS)
    else:
        side_nm = to_nm(spec.plate.die_size, where=f"{where}: plate.die_size", name="die_size")
        across = side_nm // pitch_nm
    rules = rules_of(spec, spec.emitters, where)
    seed = section.drawn_seed
    return Display.of(rules, section.tiling, seed, before, max(before, across))


def spread_of(spec: JobSpec, where: str) -> Spread:
    """Standard deviations over the displays that are made.

    Raises:
        JobError: MF127 for a bias at which dots vanish, MF104 for a stop's centre beyond the stop.
    """
    stated = None if spec.process is None else spec.process.spread
    if stated is None:
        return EXACT
    section, camera = section_of(spec, where), spec.camera
    dot_um = dot_of_pitch(section.pitch, section.dots, where=f"{where}: design.pitch") / NM_PER_UM
    bias_um, centre_um = stated.bias or 0.0, stated.centre or 0.0
    if bias_um >= dot_um:
        what = f"a bias of {bias_um:g} um, one standard deviation, closes dots of {dot_um:g} um"
        raise JobError("MF127", what, where=f"{where}: process.spread.bias", cure=f"Use less than {dot_um:g} um")
    if centre_um >= camera.stop.diameter_um / 2:
        what = f"a stop's centre {centre_um:g} um off lies outside the stop of {camera.stop.diameter_um:g} um"
        cure = f"Use less than {camera.stop.diameter_um / 2:g} um"
        raise JobError("MF104", what, where=f"{where}: process.spread.centre", cure=cure)
    return Spread(bias_um, centre_um)


def section_of(spec: JobSpec, where: str) -> DesignSection:
    """The [design] of a job. Raises JobError MF105 without one."""
    if spec.design is None:
        what = "the job has no [design] section"
        raise JobError("MF105", what, where=where, cure="Add a [design] section, as in layouts/design_bar.toml")
    return spec.design


def require_weights(section: SearchSection, settings: CaptureSettings, where: str) -> None:
    """Refuse weights that are not one for each level of light. Raises JobError MF105."""
    if section.weights is not None and len(section.weights) != len(settings.levels):
        levels = ", ".join(f"{level:g}" for level in settings.levels)
        what = f"{len(section.weights)} weights for {len(settings.levels)} levels of light, {levels} dB"
        raise JobError("MF105", what, where=f"{where}: design.weights", cure="Give one weight per level, or none")


def require_room(section: SearchSection, required: float, *, where: str) -> None:
    """Refuse denser pixels whose openings and emitters are more than a pixel.

    Args:
        required: least share of the pixel for each colour.

    Raises:
        JobError: MF123 where emitters need more than is closed.
    """
    if section.outer_dots is not None and not section.outer_dots < section.clear_dots:
        require_outer(section.outer_dots, section.clear_dots, where=f"{where}.outer_dots")
    elif isinstance(section.density, float):
        require_closed(1 - section.density, required, f"density = {section.density:g}", where=f"{where}.density")


def require_cap(section: SearchSection, rules: Constraints, *, where: str) -> None:
    """Refuse a share of denser pixels beside which a bound leaves no emitters of any shape (MF123)."""
    display: Display | None = rules["emitters"] or None
    if display is None or not isinstance(section.density, float):
        return
    dense = round(section.density * section.dots**2)
    required, found = display.rules.emitters.required, _largest_footprint(section, rules, dense)
    if found >= required - 1e-9:
        return
    largest = densest(section, rules, dense) / section.dots**2
    what = (
        f"density = {section.density:g} is above the cap: beside no shape of {dense} dots of "
        f"{', '.join(section.families)} do emitters cover more than {found:.1%} of the pixel, and {required:.1%} is "
        "asked"
    )
    cure = f'Use at most {largest:.3f}, which wires may lower, or density = "search"'
    raise JobError("MF123", what, where=f"{where}.density", cure=cure)


def densest(section: SearchSection, rules: Constraints, high: int) -> int:
    """The most clear dots, below so many, of a shape of the families beside which a bound leaves emitters.

    Args:
        section: with its families and the clear dots of one opening, below which it does not look.
        high: clear dots beside which there are none.
    """
    required = rules["emitters"].rules.emitters.required
    low = section.clear_dots
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _largest_footprint(section, rules, middle) >= required else (low, middle)
    return low


def _largest_footprint(section: SearchSection, rules: Constraints, count: int) -> float:
    """The largest footprint that the bound leaves beside any shape of so many dots."""
    units = [shape.unit for shape in _shapes(section, count)]
    footprints = footprints_of(rules, rules["emitters"].rules.emitters)
    return float(footprints.bounds(np.stack(units)).max()) if units else 0.0


def _shapes(section: SearchSection, count: int) -> Iterator[Candidate]:
    for name in section.families:
        # A family that cannot have the count has no shapes.
        with suppress(OpeningError):
            yield from FAMILIES[name](section.dots, count)


def require_closed(closed: float, required: float, stated: str, *, where: str) -> None:
    """Refuse pixels whose closed share is less than three emitters need. Raises JobError MF123."""
    needed = 3 * required
    if needed > closed + 1e-9:
        what = (
            f"{stated} leaves {closed:.1%} of the pixel closed, and three emitters of {required:.1%} are "
            f"{needed - closed:.1%} of the pixel more"
        )
        cure = f"Leave {min(1.0, needed):.1%} of the pixel closed, or ask for smaller emitters"
        raise JobError("MF123", what, where=where, cure=cure)


def scenes_line(source: Folder, images: Path | None) -> str:
    """The scenes of a folder, or synthetic ones, in words."""
    count = len(source.photographs)
    kind = "synthetic scene" if images is None else "photograph"
    return f"{count} {kind}{'' if count == 1 else 's'}{'' if images is None else f' of {images.name}'}"


def scenes_of(images: Path | None, section: DesignSection) -> Folder:
    """Photographs that openings are compared by: of a folder, or synthetic ones.

    Maps fit the very pictures they are designed on, so they get more of them.

    Raises:
        SourceError: for photographs that cannot be read.
    """
    if images is not None:
        return folder(images)
    for_map = getattr(section, "map", None) is not None
    return Folder(scene_sets.bundled(_SCENES_OF_MAPS) if for_map else scene_sets.bundled(), ())
