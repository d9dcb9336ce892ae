"""Decisions: whether a display fits, how it looks, what must be modelled of its optics; and which of runs is best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, overload

from maskfab.api.asked import AnyJob, dies_of, job_of, require_form
from maskfab.api.lengths import Length, length_text
from maskfab.api.results import Asked, InPython, Result, Told, answers
from maskfab.base import units
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target
from maskfab.base.model import Plate, Quantity
from maskfab.base.work import Progress, one_thread, silent
from maskfab.job.faults import JobFaults
from maskfab.job.process import UNSTATED
from maskfab.job.reference import USES, in_words, unused
from maskfab.job.sections import JobSpec, SceneSection
from maskfab.job.values import sections_of
from maskfab.mask.job import Job

if TYPE_CHECKING:
    from maskfab.api.camera import Camera
    from maskfab.display.eye import SeenPanel
    from maskfab.display.feasibility import Feasibility, PlateWithDisplays
    from maskfab.display.placement import LargestGap
    from maskfab.optics.scene.model_bar import Omission
    from maskfab.optics.scene.plan import Plan
    from maskfab.report.text import Quantities
    from maskfab.report.verdicts import Verdicts


# Each question imports what answers it: a scene is planned in less time than all of it takes to load.

_RULES = """State the rules of the display maker, such as

[emitters]
gap_to_opening = "4 um"
colour_gap = "8 um"
min_width = "8 um"
"""
_IN_PYTHON = 'State the rules of the display maker: rules={"emitters": {"colour_gap": "8 um", "min_width": "8 um"}}'
_HELD_AGAINST = {name: next(sections_of(JobSpec.model_fields[name])) for name in (
    "looks", "lives", "light", "wires", "display", "circuits", "emitters",
)}  # fmt: skip
"""Sections of a job that a display is held against."""
_USUAL_SAMPLES = 21
_SHOWN_DIES = 4
"""Dies of which a notebook shows pictures."""


@dataclass(frozen=True, eq=False, repr=False)
class DisplayCheck(Result):
    """Feasibility of the displays of a job.

    Attributes:
        gaps: widest gap between colours, by die, where it was asked for.
        reference: die that others are compared with, which may be meant to fail, and is judged only if it is alone.
        unused: keys and tables that the job states and the answer does not depend on.
        notes: by die, that its seed is none of those that its display is known to fit, or that its tiling was assumed.
    """

    built: PlateWithDisplays
    gaps: Mapping[str, LargestGap]
    digest: str
    reference: str | None = None
    unused: tuple[str, ...] = ()
    notes: Mapping[str, Quantity] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every display but the reference fits, or nothing is required of it and no rule is broken, and keeps
        the limits of the eye and of life that the job states."""
        displays = self.built.displays
        held = [one for name, one in displays.items() if name != self.reference or len(displays) == 1]
        return all(one.passed and (one.judged is None or one.judged.passed) for one in held)

    @property
    def verdicts(self) -> Verdicts:
        """Verdicts on the displays."""
        from maskfab.report.verdicts import Verdicts

        return Verdicts.of((), self.built.displays, len(self.built.plate.dies), self.reference)

    def __getitem__(self, die: str) -> Feasibility:
        return self.built.displays[die]

    def to_dict(self) -> dict[str, Any]:
        """Every die with the answer about it."""
        from maskfab.report.documents import display as check_data

        return check_data.check_document(
            self.built, self.gaps, self.digest, self.unused, self.notes, passed=self.passed
        )

    def _shown(self) -> str:
        """Emitters, wires and light of every die, of the first dies alone where there are many."""
        from maskfab.report.figures.display import pictures

        panels = {die.name: die.panel for die in self.built.plate.dies}
        shown = list(self.built.displays.items())[:_SHOWN_DIES]
        return "".join(f"<h4>{name}</h4>{''.join(pictures(panels[name], found).values())}" for name, found in shown)

    def __str__(self) -> str:
        from maskfab.report.documents import display as display_text

        lines = [
            line
            for one in self.built.plate.dies
            for line in display_text.display_lines(
                one.name, self.built.displays.get(one.name), self.gaps.get(one.name), self.notes.get(one.name)
            )
        ]
        verdicts = self.verdicts.lines[2:] if self.built.displays else ()
        return "\n".join([*lines, *verdicts, *in_words(self.unused)])


@dataclass(frozen=True, eq=False, repr=False)
class Rendering(Result):
    """Pictures on panels, as the eye sees them.

    Attributes:
        samples: along the side of a display pixel.
        unused: keys and tables that the job states and the pictures do not depend on.
    """

    panels: Mapping[str, SeenPanel]
    samples: int
    digest: str
    unused: tuple[str, ...] = ()

    def __getitem__(self, die: str) -> Quantities:
        from maskfab.report.text import Quantities

        return Quantities(self.panels[die].quantities)

    def to_dict(self) -> dict[str, Any]:
        """Everything that was measured."""
        from maskfab.report.documents.display import render_document

        return render_document(list(self.panels.values()), self.samples, self.digest, self.unused)

    def save(self, out: Annotated[str | Path, "FOLDER"], progress: InPython[Progress] = silent) -> list[Path]:
        """Write emitted light, the image that the eye sees, a comparison and the results into a new directory.

        Args:
            out: new folder for emitted light, the image that the eye sees, a comparison and the results.
            progress: told where the work stands.
        """
        from maskfab.report.pages import pictures as render_files

        panels = list(self.panels.values())
        return render_files.write_rendering(Path(out), panels, self.samples, self.digest, progress, self.unused)

    def picture(self) -> bytes:
        """A PNG of the panels side by side."""
        from maskfab.report.pages.pictures import comparison

        return comparison(list(self.panels.values()))

    def __str__(self) -> str:
        from maskfab.report.text import table_lines

        lines = [line for name, panel in self.panels.items() for line in (name, *table_lines(panel.quantities))]
        return "\n".join([*lines, *in_words(self.unused)])

    def _repr_html_(self) -> str:
        from maskfab.report.text import html_table

        tables = (f"<h4>{name}</h4>{html_table(panel.quantities)}" for name, panel in self.panels.items())
        return "".join([self._shown(), *tables])

    def _repr_png_(self) -> bytes:
        return self.picture()


@dataclass(frozen=True, eq=False, repr=False)
class Plans(Result):
    """The model of every die, and what is left out whatever is asked for.

    Attributes:
        accuracy: admissible relative L2 error of the PSF.
        omissions: by die; none where neither scene nor blank is stated.
        unused: keys and tables that the job states and the plan does not depend on.
    """

    accuracy: float
    plans: Mapping[str, Plan]
    omissions: Mapping[str, Sequence[Omission]]
    unused: tuple[str, ...] = ()

    def __getitem__(self, die: str) -> Plan:
        return self.plans[die]

    def to_dict(self) -> dict[str, Any]:
        """Plain data; lengths in micrometres, times in seconds."""
        from maskfab.optics.scene import plan as plans
        from maskfab.optics.scene.model_bar import weighed

        dies = [
            {**plans.plan_document(name, plan), "not_modelled": weighed(self.omissions[name], self.accuracy)}
            for name, plan in self.plans.items()
        ]
        return {"accuracy": self.accuracy, "dies": dies, "unused": list(self.unused)}

    def __str__(self) -> str:
        from maskfab.optics.scene import plan as plans
        from maskfab.optics.scene.model_bar import weighed_table

        lines = [
            line
            for name, plan in self.plans.items()
            for line in [*plans.plan_table(name, plan), *weighed_table(self.omissions[name], self.accuracy)]
        ]
        return "\n".join([*lines, *in_words(self.unused)])


@overload
def check(
    job: AnyJob, image: str | Path | None = ..., *, look: Literal[True], camera: Camera | None = ...,
    rules: Mapping[str, Any] | None = ..., die: str | Sequence[str] | None = ...,
    dpi: float | None = ..., distance: Length | None = ..., pixels: int | None = ..., samples: int | None = ...,
    jod: bool = ..., progress: Progress = ...
) -> Rendering: ...  # fmt: skip
@overload
def check(
    job: AnyJob, *, optics: Literal[True], camera: Camera | None = ..., rules: Mapping[str, Any] | None = ...,
    die: str | Sequence[str] | None = ..., progress: Progress = ...
) -> Plans: ...  # fmt: skip
@overload
def check(
    job: AnyJob, *, camera: Camera | None = ..., rules: Mapping[str, Any] | None = ...,
    die: str | Sequence[str] | None = ..., largest_gap: bool = ..., progress: Progress = ...
) -> DisplayCheck: ...  # fmt: skip
@checked_arguments
@one_thread
def check(
    job: AnyJob,
    image: Annotated[str | Path | None, "<IMAGE>"] = None,
    *,
    rules: InPython[Mapping[str, Any] | None] = None,
    die: str | Sequence[str] | None = None,
    largest_gap: bool = False,
    look: bool = False,
    dpi: float | None = None,
    distance: Length | None = None,
    pixels: int | None = None,
    samples: int | None = None,
    jod: bool = False,
    optics: bool = False,
    camera: Camera | None = None,
    progress: Progress = silent,
) -> DisplayCheck | Rendering | Plans:
    """Check whether emitters, circuits and wires fit in the opaque area around the openings, and prove it where not;
    whether the display looks right; and whether it lives long enough.

    With --look, render pictures on the panels as the eye sees them: S-CIELAB difference, grain, colour fringes, and the
    border of the die in the regular display. With --optics, plan the model of the job's [scene]: effects to include,
    error of those omitted, time and memory.

    Examples:
        $ maskfab check job.toml
        $ maskfab check job.toml --die TOLED_R150 --largest-gap --json
        $ maskfab check job.toml photo.jpg --look --die TOLED_R300 -o seen
        $ maskfab check job.toml --optics
        >>> import maskfab as mf
        >>> bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
        >>> rules = {"emitters": {"colour_gap": "8 um", "min_width": "8 um"}}
        >>> mf.check(mf.Panel.tile(bar, size="4.4 mm"), rules=rules).passed
        True

    Args:
        job: job file (.toml), with [emitters] unless for optics; in Python also a plate, panels or a loaded job.
        image: photograph to show as well, with look.
        rules: sections of a job file that plate or panels are held against, such as
            ``{"emitters": {...}, "wires": {...}}``, lengths as here; in place of the plate's own.
        die: die of the job; by default all, with look all with emitters.
        largest_gap: also find the widest possible gap between colours.
        look: show how the display looks.
        dpi: dots per inch to scale the panels to, with look; by default that of [looks], or their own.
        distance: viewing distance, with look; by default that of the job's [looks], or ``"300 mm"``.
        pixels: display pixels along a side, with look; by default those of the die's map, or up to 100.
        samples: samples along the side of a display pixel, with look; by default 21.
        jod: also score with ColorVideoVDP, with look; needs maskfab[eye].
        optics: plan what the optics of each die have to model.
        camera: of a plate or of panels; by default the plate's, or that of protocol F1.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a job without [emitters], a die that there is not, or what goes with another form; MF102 for
            rules that are no sections of a display, and as for a job; of look also MF121 for what cannot be shown, of
            optics MF114 or MF115 if a scene cannot be modelled.
    """
    seen = {"image": image, "dpi": dpi, "distance": distance, "pixels": pixels, "samples": samples, "jod": jod}
    require_form("look", seen, of=look)
    asked = [name for name, held in {"optics": optics, "look": look, "largest_gap": largest_gap}.items() if held]
    if len(asked) > 1:
        cure = f"Leave {asked[0]} out, or {asked[1]}"
        raise JobError("MF105", f"{asked[0]} and {asked[1]} do not go together", where=asked[1], cure=cure)
    if rules is not None and isinstance(job, Job | str | Path):
        cure = "Change what the job states, or give its panels and rules"
        raise JobError("MF105", "the job states the rules of its display", where="rules", cure=cure)
    if optics:
        return _plans(job_of(job, camera, _rules(rules)), die)
    from maskfab.display.feasibility import plate_of

    loaded = job_of(job, camera, _rules(rules), plate_of)
    if look:
        return _rendering(
            loaded, image, die, dpi=dpi, distance=distance, pixels=pixels,
            samples=_USUAL_SAMPLES if samples is None else samples, with_jod=jod, progress=progress,
        )  # fmt: skip
    cure = _RULES if isinstance(job, Job | str | Path) else _IN_PYTHON
    return _fit(loaded, die, cure, largest_gap=largest_gap, progress=progress)


def _rules(stated: Mapping[str, Any] | None) -> Mapping[str, Any] | None:
    """Sections that a display is held against."""
    for name in stated or {}:
        if name in _HELD_AGAINST:
            continue
        (*_, section) = [key for key, kind in _HELD_AGAINST.items() if name in kind.model_fields] or ("",)
        what = f"rules are by sections of a job, and {name!r} is " + (f"a key of [{section}]" if section else "none")
        cure = f'Write rules={{"{section}": {{"{name}": ...}}}}' if section else f"Use {', '.join(_HELD_AGAINST)}"
        raise JobError("MF102", what, where=f"rules: {name}", cure=cure)
    return stated


def _fit(
    loaded: Job, die: str | Sequence[str] | None, cure: str, *, largest_gap: bool, progress: Progress
) -> DisplayCheck:
    from maskfab.display.feasibility import display_rules, displays, plate_of, widest_gaps
    from maskfab.runs.stages import executor_of

    rules, faults = display_rules(loaded), JobFaults.of_spec(loaded.spec)
    if rules is None:
        faults.add(JobError("MF105", "the job asks for no emitters", where=f"{loaded.where}: emitters", cure=cure))
    plate = plate_of(loaded, faults)
    faults.refuse()
    assert rules is not None
    assert plate is not None
    _, plate = _asked_of(plate, die)
    with executor_of(loaded) as executor:
        built = displays(loaded, plate, progress, executor=executor)
    gaps = widest_gaps(plate, rules, progress) if largest_gap else {}
    left = unused(loaded.spec, *USES["check"])
    return DisplayCheck(built, gaps, loaded.digest, loaded.compared_with, left, loaded.notes)


def _asked_of(plate: Plate, die: str | Sequence[str] | None) -> tuple[tuple[str, ...], Plate]:
    """Names of the dies that are asked for, and a plate of these alone: others need not be worked on."""
    asked = dies_of(die, [one.name for one in plate.dies])
    return asked, replace(plate, dies=tuple(one for one in plate.dies if one.name in asked))


def _rendering(
    loaded: Job,
    image: str | Path | None,
    die: str | Sequence[str] | None,
    *,
    dpi: float | None,
    distance: Length | None,
    pixels: int | None,
    samples: int,
    with_jod: bool,
    progress: Progress,
) -> Rendering:
    from maskfab.display.emitted_light import emitters_of, has_emitters
    from maskfab.display.eye import FEWEST_PIXELS, judge, target_pictures
    from maskfab.display.eye_and_life import EyeAndLife
    from maskfab.display.feasibility import display_rules, displays, map_sizes
    from maskfab.display.looks import field_of
    from maskfab.display.pictures import read_picture

    asked = EyeAndLife.of(loaded.spec.looks, loaded.spec.lives)
    if distance is not None:
        looked_from = units.parse_length_um(length_text(distance, "distance"), where="distance", zero_allowed=True)
        asked = asked.viewed(distance_um=looked_from)
    if dpi is not None:
        units.parse_pitch_um(f"{dpi!r} dpi", where="dpi")
        asked = asked.viewed(dpi=dpi)
    looks, rules = asked.looks, display_rules(loaded)
    limits = {"flat_delta_e_mean": looks.delta_e, "grain_slow": looks.grain, "edge_fringe": looks.fringe}
    chosen, plate = _asked_of(loaded.plate(), die)
    panels = {one.name: one.panel for one in displays(loaded, plate, progress).plate.dies}
    photograph = None if image is None else read_picture(Path(image))
    lit = [name for name in chosen if has_emitters(panels[name])]
    shown = chosen if die else tuple(lit or panels)
    for name in shown:
        emitters_of(panels[name])
    judged, maps = {}, map_sizes(loaded)
    for done, name in enumerate(shown):
        progress("panels", done, len(shown))
        panel = panels[name]
        viewing = asked.viewing(panel.cell_size.pitch_um)
        usual = field_of(panel.orientations.shape, viewing, maps.get(name), least=FEWEST_PIXELS)
        side = min(usual) if pixels is None else pixels
        judged[name] = judge(
            name, panel, target_pictures(side, photograph), samples, viewing,
            reference=None if rules is None else asked.reference(panel.pitch_nm, rules.emitters), with_jod=with_jod,
            limits={name: limit for name, limit in limits.items() if limit is not None},
        )  # fmt: skip
    progress("panels", len(shown), len(shown))
    return Rendering(judged, samples, loaded.digest, unused(loaded.spec, *USES["check --look"]))


def _plans(loaded: Job, die: str | Sequence[str] | None) -> Plans:
    from maskfab.optics.scene import plan as plans
    from maskfab.optics.scene.model_bar import bar_of_scene
    from maskfab.optics.scene.scene import Scene

    loaded.check_window()
    section = loaded.spec.scene or SceneSection()
    panels = loaded.panels()
    panels = {name: panels[name] for name in dies_of(die, panels)}
    by_die = {
        name: plans.plan(panel, loaded.camera, loaded.scene or Scene(), section.accuracy)
        for name, panel in panels.items()
    }
    # A job that asks for no scene and says nothing of its plate has its bars in the report.
    asked = loaded.scene is not None or loaded.blank != UNSTATED
    slope = 0.0 if loaded.scene is None else loaded.scene.slope(loaded.camera)
    bars = {
        name: bar_of_scene(panel, loaded.camera, loaded.blank, slope) if asked else () for name, panel in panels.items()
    }
    return Plans(section.accuracy, by_die, bars, unused(loaded.spec, *USES["check --optics"]))


@answers(check)
def _check(asked: Asked) -> Told:
    """Pictures are saved while progress is watched, and only a look has any."""
    if asked.out is None:
        return Told.of(asked.found())
    require_form("look", {"out": asked.out}, of=bool(asked.stated.get("look")))
    check_target(asked.out, force=False)
    rendering = asked.found()
    return Told.of(rendering, rendering.save(asked.out, asked.progress))
