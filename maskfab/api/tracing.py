"""An opening and a job from a microscope picture of a display."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from maskfab.api.results import Result
from maskfab.base import __version__, resources
from maskfab.base.errors import JobError
from maskfab.base.folders import check_target, staged
from maskfab.base.units import NM_PER_UM

if TYPE_CHECKING:
    from maskfab.api.lengths import Length
    from maskfab.api.opening import Opening
    from maskfab.base.arrays import Floats
    from maskfab.display.micrograph import SeenCell
    from maskfab.report.figures.sheet import Drawing

JOB, PICTURE = "job.toml", "outline.png"
_SETTINGS = {"clear": "dark or bright", "pixels": "a whole number"}


@dataclass(frozen=True, repr=False)
class Traced(Result):
    """The opening of a display in a microscope picture, with a job that takes it.

    Attributes:
        job: of a plate with this opening alone.
        files: all that was written.
        opening: in dots.
        seen: the mean cell, its outline and its numbers.
        light: the picture [rows, columns], linear light, row 0 on top.
    """

    job: Path
    files: tuple[Path, ...]
    opening: Opening
    seen: SeenCell
    light: Floats

    def to_dict(self) -> dict[str, Any]:
        """The paths and the numbers, lengths in um and in pixels of the picture."""
        seen = self.seen
        return {
            "job": str(self.job), "files": [str(path) for path in self.files], "name": self.opening.name,
            "dots": self.opening.dots, "pixels": seen.pixels, "periods": list(seen.periods),
            "open_ratio": seen.open_ratio, "open_ratio_bar": seen.open_ratio_bar,
            "px_per_um": seen.px_per_um, "px_per_um_bar": seen.px_per_um_bar, "turn_deg": seen.turn_deg,
            "skew_deg": seen.skew_deg, "blur_um": seen.blur_px / seen.px_per_um,
            "edge_bar_um": seen.edge_bar_px / seen.px_per_um, "cells": seen.cells, "cells_differ": seen.differ,
        }  # fmt: skip

    def plot(self) -> Drawing:
        """The outline over the mean cell, and over the picture."""
        from maskfab.report.figures import micrograph

        return micrograph.outlines(self.light, self.seen, self.opening)

    def __str__(self) -> str:
        seen, scale = self.seen, self.seen.px_per_um
        held = f", {seen.pixels} x {seen.pixels} pixels of the display" * (seen.pixels > 1)
        cells = "" if seen.differ is None else f"; single cells differ by {seen.differ:.2%} rms"
        edge, dot_um = (
            f"{seen.edge_bar_px / scale:.2g} um ({seen.edge_bar_px:.2f} pixels)",
            self.opening.dot_nm / NM_PER_UM,
        )
        lines = [
            f"open ratio {seen.open_ratio:.2%} ± {seen.open_ratio_bar:.2%}{cells}",
            f"scale {scale:.5g} ± {seen.px_per_um_bar:.1g} pixels/um in the middle, if the pitch is as stated",
            f"turned by {seen.turn_deg:+.2f} deg, skewed by {seen.skew_deg:+.2f} deg",
            f"edges ± {edge}, blur {seen.blur_px / scale:.2g} um rms",
            f"mean of {seen.cells:.1f} periods",
            f"the cell is {self.opening.pitch_um:.7g} um{held}, {self.opening.dots} dots of {dot_um:g} um",
        ]
        if max(seen.periods) > 1:
            lines.append(
                f"it holds {seen.periods[0]} x {seen.periods[1]} periods alike; --set pixels=N says how many pixels"
            )
        return "\n".join(
            [*lines, *map(str, self.files), f"Next: look at {self.files[-1]}, then maskfab run {self.job}"]
        )


def traced(
    folder: Path,
    photograph: Path,
    *,
    pitch: Length | None,
    dots: int | None,
    settings: Mapping[str, Any],
    name: str,
    command: str,
) -> Traced:
    """Read a picture, and write opening, job and outline into a new folder.

    Raises:
        JobError: MF102 or MF105 for settings, MF103 to MF107 for the pitch, MF110 for the name, MF121 for the picture.
        SourceError: for a picture that cannot be read.
        OpeningError: MF207 to MF211 for one that shows no cell.
    """
    from maskfab.api.lengths import length_text
    from maskfab.api.opening import Opening, dots_near
    from maskfab.base.units import parse_pitch_um
    from maskfab.display.micrograph import seen_cell
    from maskfab.display.pictures import read_picture
    from maskfab.job.values import check_name
    from maskfab.mask.opening_file import opening_text
    from maskfab.mask.opening_masks import check_dots
    from maskfab.optics.colour import light_of_code

    clear, pixels = _settings(settings)
    if pitch is None:
        cure = "Add the pitch of the display, such as --pitch '78 um' or --pitch '326 dpi'"
        raise JobError("MF105", "a picture does not say how large it is", where="pitch", cure=cure)
    pitch_um = parse_pitch_um(length_text(pitch, "pitch"), where="pitch")
    check_name(name, where="name")
    place = check_target(folder, force=False)
    picture = read_picture(photograph)
    values = picture.values[:, :, : 3 if picture.values.shape[2] > 2 else 1].astype(float)
    light = (light_of_code(values) if picture.coded else values).mean(2)
    seen = seen_cell(light, pitch_um, clear, pixels, str(photograph))
    side_um = pitch_um * seen.pixels
    if dots is None:
        dots = dots_near(round(min(160.0, max(40.0, side_um))), 1, side_um)
    check_dots(dots, "dots")
    dot_nm = max(1, round(side_um * NM_PER_UM / dots))
    made: dict[str, str | int | float] = {"author": "maskfab", "command": command, "version": __version__}
    made |= {"source": photograph.name, "open_ratio_seen": round(seen.open_ratio, 6)}
    made |= {
        "open_ratio_bar": round(seen.open_ratio_bar, 6),
        "edge_bar_um": round(seen.edge_bar_px / seen.px_per_um, 4),
    }
    opening = Opening(name, seen.dots(dots), dot_nm, made)
    written = (JOB, f"{name}.toml", PICTURE)
    found = Traced(folder / JOB, tuple(folder / each for each in written), opening, seen, light)
    text = resources.template("micrograph.toml").format(
        told=f"open ratio {seen.open_ratio:.2%} ± {seen.open_ratio_bar:.2%}", name=name, plate=name.upper(),
        die=name.upper(), dot_um=dot_nm / NM_PER_UM, pitch_um=opening.pitch_um,
    )  # fmt: skip
    with staged(place) as made_in:
        (made_in / JOB).write_text(text, encoding="utf-8")
        (made_in / written[1]).write_text(opening_text(opening), encoding="utf-8")
        found.plot().save(made_in / PICTURE)
    return found


def _settings(stated: Mapping[str, Any]) -> tuple[Literal["dark", "bright"], int | None]:
    for key in stated:
        if key not in _SETTINGS:
            cure = "It has: " + ", ".join(f"{name} ({what})" for name, what in _SETTINGS.items())
            raise JobError("MF102", f"a micrograph has no {key!r}", where="set", cure=cure)
    clear, pixels = stated.get("clear", "dark"), stated.get("pixels")
    if clear not in ("dark", "bright"):
        cure = "Write clear=dark for reflected light, clear=bright for transmitted"
        raise JobError("MF105", f"clear = {clear!r} is neither dark nor bright", where="clear", cure=cure)
    if pixels is not None and not (str(pixels).isascii() and str(pixels).isdigit() and 0 < int(pixels) < 100):
        cure = "Write the pixels along the side of the repeating cell, such as pixels=2"
        raise JobError("MF105", f"pixels = {pixels!r} is no whole number of 1 to 99", where="pixels", cure=cure)
    return clear, None if pixels is None else int(pixels)
