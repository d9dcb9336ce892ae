"""Displays of a plate: room for emitters and wires, and how they look."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, overload

from maskfab.api.jobs import AnyJob, dies_of, job_of
from maskfab.api.lengths import Length, length_text
from maskfab.base import units
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.model import Quantity
from maskfab.base.work import Progress, one_thread, silent
from maskfab.display.emitted_light import Viewing, emitters_of, has_emitters
from maskfab.display.eye import SeenPanel, judge, target_pictures
from maskfab.display.feasibility import Feasibility, PlateWithDisplays, display_rules, displays, widest_gaps
from maskfab.display.pictures import read_picture
from maskfab.display.placement import LargestGap
from maskfab.job.reference import USES, in_words, unused
from maskfab.job.shop import Shop
from maskfab.mask.houses.files import check_package
from maskfab.mask.houses.findings import Finding, accepted, answer_of, mail_of
from maskfab.mask.houses.profiles import load_shop
from maskfab.report.documents import check as check_data
from maskfab.report.documents import check as display_text
from maskfab.report.pages import pictures
from maskfab.report.rows.text import Quantities, html_table, table_lines
from maskfab.runs.pipeline import executor_of

_RULES = """State the rules of the display maker, such as

[emitters]
gap_to_opening = "4 um"
colour_gap = "8 um"
min_width = "8 um"
"""
_USUAL_PIXELS = 100


@dataclass(frozen=True, eq=False, repr=False)
class DisplayCheck:
    """Feasibility of the displays of a job.

    Attributes:
        built: the plate with emitters and wires, and what was found of each die.
        gaps: widest gap between colours, by die, where it was asked for.
        digest: of the job.
        unused: keys and tables that the job states and the answer does not depend on.
        notes: by die, that its seed is none of those that its display is known to fit.
    """

    built: PlateWithDisplays
    gaps: Mapping[str, LargestGap]
    digest: str
    unused: tuple[str, ...] = ()
    notes: Mapping[str, Quantity] = field(default_factory=dict)

    @property
    def passed(self) -> bool:
        """Whether every display fits, or nothing is required of it and no rule is broken."""
        return all(found.passed for found in self.built.displays.values())

    def __getitem__(self, die: str) -> Feasibility:
        return self.built.displays[die]

    def to_dict(self) -> dict[str, Any]:
        """Every die with the answer about it."""
        return check_data.check_document(
            self.built, self.gaps, self.digest, self.unused, self.notes, passed=self.passed
        )

    def __str__(self) -> str:
        lines = [
            line
            for each in self.built.plate.dies
            for line in display_text.display_lines(
                each.name, self.built.displays.get(each.name), self.gaps.get(each.name), self.notes.get(each.name)
            )
        ]
        return "\n".join([*lines, *in_words(self.unused)])


@dataclass(frozen=True, eq=False, repr=False)
class ShopCheck:
    """A plate held against the rules of a mask shop; ``mail`` asks the shop for what it does not publish."""

    shop: Shop
    findings: tuple[Finding, ...]
    digest: str
    unused: tuple[str, ...] = ()
    mail: str = ""

    @property
    def passed(self) -> bool:
        """Whether no rule is broken."""
        return accepted(self.findings)

    def to_dict(self) -> dict[str, Any]:
        """The verdict and every rule."""
        return {
            "verdict": "pass" if self.passed else "fail",
            "shop": self.shop.name,
            "job_hash": self.digest,
            "answer": answer_of(self.findings),
            "rules": [dict(vars(each)) for each in self.findings],
            "unused": list(self.unused),
            "mail": self.mail,
        }

    def __str__(self) -> str:
        return "\n".join([*(str(each) for each in self.findings), *in_words(self.unused)])


@overload
def check(
    job: AnyJob,
    *,
    die: str | Sequence[str] | None = ...,
    largest_gap: bool = ...,
    shop: None = ...,
    progress: Progress = ...,
) -> DisplayCheck: ...
@overload
def check(job: AnyJob, *, shop: str, formats: Sequence[str] = ..., progress: Progress = ...) -> ShopCheck: ...
@checked_arguments
@one_thread
def check(
    job: AnyJob,
    *,
    die: str | Sequence[str] | None = None,
    largest_gap: bool = False,
    shop: str | None = None,
    formats: Sequence[str] = (),
    progress: Progress = silent,
) -> DisplayCheck | ShopCheck:
    """Check whether emitters, circuits and wires fit in the opaque area around the openings, and prove it where not;
    or, with a shop, whether the plate keeps its rules.

    Args:
        job: a plate, a loaded job, or the path of a job file; with [emitters], unless for a shop.
        die: one or several; by default all.
        largest_gap: also find the widest possible gap between colours.
        shop: name of a mask shop, or the path of a profile, whose rules are checked instead.
        formats: that the shop is sent; by default its first.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for a job without [emitters], or a die or a format that there is not.
        OutputError: MF420 or MF421 for the shop.
    """
    if formats and shop is None:
        cure = "Name a shop, or leave formats out"
        raise JobError("MF105", "formats applies to a shop's rules only", where="formats", cure=cure)
    if shop is not None:
        for name, value in {"die": die, "largest_gap": largest_gap}.items():
            if value:
                cure = f"Leave {name} out, or the shop"
                raise JobError("MF105", f"{name} does not apply to a shop's rules", where=name, cure=cure)
        return _check_for_shop(job, shop, formats, progress)
    loaded = job_of(job)
    rules = display_rules(loaded)
    if rules is None:
        raise JobError("MF105", "the job asks for no emitters", where=f"{loaded.where}: emitters", cure=_RULES)
    plate = loaded.plate()
    asked = dies_of(die, [each.name for each in plate.dies])
    plate = replace(plate, dies=tuple(each for each in plate.dies if each.name in asked))
    with executor_of(loaded) as executor:
        built = displays(loaded, plate, progress, executor=executor)
    gaps = widest_gaps(plate, rules, progress) if largest_gap else {}
    return DisplayCheck(built, gaps, loaded.digest, unused(loaded.spec, *USES["check"]), loaded.seed_notes)


def _check_for_shop(job: AnyJob, shop: str, formats: Sequence[str], progress: Progress) -> ShopCheck:
    from maskfab.api.verbs.shops import formats_of

    profile, sent = load_shop(shop), formats_of(formats)
    loaded = job_of(job)
    progress("rules", 0, 1)
    plate = loaded.plate()
    findings = check_package(loaded.spec, plate, profile, sent)
    progress("rules", 1, 1)
    left = unused(loaded.spec, *USES["check --shop"])
    return ShopCheck(profile, findings, loaded.digest, left, mail_of(plate.name, findings))


@dataclass(frozen=True, eq=False, repr=False)
class Rendering:
    """Pictures on panels, as the eye sees them.

    Attributes:
        panels: by die.
        samples: along the side of a display pixel.
        digest: of the job.
        unused: keys and tables that the job states and the pictures do not depend on.
    """

    panels: Mapping[str, SeenPanel]
    samples: int
    digest: str
    unused: tuple[str, ...] = ()

    def __getitem__(self, die: str) -> Quantities:
        return Quantities(self.panels[die].quantities)

    def to_dict(self) -> dict[str, Any]:
        """Everything that was measured."""
        return pictures.render_document(list(self.panels.values()), self.samples, self.digest, self.unused)

    def save(self, out: str | Path, progress: Progress = silent) -> list[Path]:
        """Write emitted light, the image that the eye sees, a comparison and the results into a new directory.

        Raises:
            OutputError: MF401 or MF402 for a place that cannot be written.
        """
        panels = list(self.panels.values())
        return pictures.write_rendering(Path(out), panels, self.samples, self.digest, progress, self.unused)

    def picture(self) -> bytes:
        """A PNG of the panels side by side."""
        from maskfab.report.pages.pictures import comparison

        return comparison(list(self.panels.values()))

    def __str__(self) -> str:
        lines = [line for name, each in self.panels.items() for line in (name, *table_lines(each.quantities))]
        return "\n".join([*lines, *in_words(self.unused)])

    def _repr_html_(self) -> str:
        return "".join(f"<h4>{name}</h4>{html_table(each.quantities)}" for name, each in self.panels.items())

    def _repr_png_(self) -> bytes:
        return self.picture()


@checked_arguments
@one_thread
def render(
    job: AnyJob,
    image: str | Path | None = None,
    *,
    die: str | Sequence[str] | None = None,
    dpi: float | None = None,
    distance: Length = "300 mm",
    pixels: int | None = None,
    samples: int = 21,
    with_jod: bool = False,
    progress: Progress = silent,
) -> Rendering:
    """Render pictures on the panels as the eye sees them, with S-CIELAB difference, grain and colour fringes.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        image: a photograph to show as well.
        die: one or several; by default all with emitters.
        dpi: scale the panels to it; by default their own.
        distance: of the viewer.
        pixels: of the display along a side; by default 100, or as many as the panel has.
        samples: along the side of a display pixel.
        with_jod: also score with ColorVideoVDP.
        progress: told where the work stands.

    Raises:
        JobError: MF105 for an unknown die or a panel without emitters; MF121 for what cannot be shown.
    """
    distance_um = units.parse_length_um(length_text(distance), where="distance", zero_allowed=True)
    pitch_um = None if dpi is None else units.parse_pitch_um(f"{dpi!r} dpi", where="dpi")
    loaded = job_of(job)
    panels = {each.name: each.panel for each in displays(loaded).plate.dies}
    chosen = dies_of(die, panels)
    photograph = None if image is None else read_picture(Path(image))
    lit = [name for name in chosen if has_emitters(panels[name])]
    shown = chosen if die else tuple(lit or panels)
    for name in shown:
        emitters_of(panels[name])
    judged = {}
    for done, name in enumerate(shown):
        progress("panels", done, len(shown))
        panel = panels[name]
        viewing = Viewing(pitch_um or panel.cell_size.pitch_um, distance_um)
        side = min(_USUAL_PIXELS, *panel.orientations.shape) if pixels is None else pixels
        judged[name] = judge(name, panel, target_pictures(side, photograph), samples, viewing, with_jod=with_jod)
    progress("panels", len(shown), len(shown))
    return Rendering(judged, samples, loaded.digest, unused(loaded.spec, *USES["render"]))
