"""The opening of one display pixel, from numbers, an array or a file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from maskfab.api.lengths import Length, length_text
from maskfab.base import __version__, model
from maskfab.base.arrays import Mask
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError, OutputError
from maskfab.base.files import suffix_of
from maskfab.base.units import NM_PER_UM, parse_pitch_um
from maskfab.base.work import Progress, one_thread, silent
from maskfab.job.values import check_name
from maskfab.mask import emitter_layouts, opening_file
from maskfab.mask import opening_masks as decode
from maskfab.mask import opening_masks as shapes

if TYPE_CHECKING:
    from maskfab.api.camera import Camera
    from maskfab.report.figures.sheet import Drawing


SHAPES = ("stripe", "blobs", "diamond-discs", *emitter_layouts.DISPLAYS)
_USUAL_DOTS, _USUAL_PITCH = 21, "168 um"


class Opening(model.Opening):
    """The clear shape in one display pixel, bool ``mask`` [dots, dots] with row 0 the lowest.

    Examples:
        >>> import maskfab as mf
        >>> bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
        >>> bar.clear_dots, round(bar.open_ratio, 3), bar.dot_nm
        (105, 0.238, 8000)
    """

    @classmethod
    @checked_arguments
    def bar(cls, dots: int, size: tuple[int, int], pitch: Length, *, name: str | None = None) -> Self:
        """A rectangle of width x height dots in the middle of the pixel.

        Raises:
            JobError: MF103, MF104, MF106 or MF107 for the pitch, MF104 or MF105 for the size, MF110 for the name.
        """
        if isinstance(size, str) or not isinstance(size, Sequence) or len(size) != 2:
            what = f"size = {size!r} is not width and height in dots"
            raise JobError("MF105", what, where="size", cure="Write size = (15, 7)")
        width, height = _whole(size[0], "size"), _whole(size[1], "size")
        mask = shapes.stripe(_whole(dots, "dots"), width, width * height)
        made: dict[str, str | int | float] = {
            "author": "maskfab",
            "command": f"maskfab.Opening.bar(dots={dots}, size={(width, height)}, pitch={pitch!r})",
            "version": __version__,
        }
        return cls._checked(name or f"bar_{width}x{height}", mask, pitch, made, "Opening.bar")

    @classmethod
    @checked_arguments
    def of(cls, mask: ArrayLike, pitch: Length, *, name: str = "opening", threshold: float | None = None) -> Self:
        """An opening from an array [dots, dots] of bool or of 0 and 1, row 0 the lowest.

        Examples:
            >>> import maskfab as mf
            >>> mf.Opening.of([[0, 1], [1, 1]], pitch="16 um").clear_dots
            3
            >>> mf.Opening.of([[0.2, 0.9], [0.7, 0.4]], pitch="16 um", threshold=0.5).clear_dots
            2

        Args:
            mask: the array; a grey one needs a threshold.
            pitch: side of the pixel.
            name: of the opening.
            threshold: value from which on a dot is clear.

        Raises:
            OpeningError: MF201 not square, MF202 other values, or grey without a threshold, MF203 nothing clear.
            JobError: MF103 to MF107 for the pitch, MF110 for the name, MF115 for too many dots, MF156 for a number that
                is no pitch.
        """
        return cls._checked(name, mask_of(mask, "Opening.of: mask", threshold), pitch, {}, "Opening.of")

    @classmethod
    @checked_arguments
    def shape(
        cls,
        kind: str,
        *,
        dots: int | None = None,
        pitch: Length | None = None,
        clear_dots: int | None = None,
        width_dots: int = 5,
        size_ratio: float = 0.7,
        aspect: float = 1.25,
        exponent: float = 4.0,
        lengths: Mapping[str, int] | None = None,
        name: str | None = None,
        command: str | None = None,
    ) -> Self:
        """Draw a parametric opening, or the opening of a display with its emitters.

        Examples:
            >>> import maskfab as mf
            >>> mf.Opening.shape("stripe", width_dots=6).clear_dots
            126

        Args:
            kind: one of :func:`maskfab.shapes`.
            dots: along the side of a cell; by default 21, or a display's own, or near that so that they make the pitch.
            pitch: side of a cell, to the nearest that dots of whole nanometres make; by default 168 um, or a
                display's own.
            clear_dots: number of clear dots; blobs and discs need it.
            width_dots: of a stripe.
            size_ratio: of blobs: size of the small ones relative to the large ones.
            aspect: of blobs: length over width.
            exponent: of blobs: 2 is an ellipse, larger is squarer.
            lengths: of displays: in dots, by name.
            name: of the opening; by default the kind.
            command: what reproduces it, for its provenance; by default this call.

        Raises:
            JobError: MF105 for an unknown kind or a missing number, MF102 for lengths that it does not have, MF104 to
                MF107 for numbers, MF110 for the name.
            OpeningError: MF204 where so many dots cannot be clear.
        """
        if kind not in SHAPES:
            raise JobError("MF105", f"there is no shape {kind!r}", where="kind", cure=f"Use {', '.join(SHAPES)}")
        called = check_name(name or kind.replace("-", "_"), where="name")
        display = emitter_layouts.DISPLAYS.get(kind)
        changed = dots is not None or pitch is not None or bool(lengths)
        own_dots, own_pitch = (display.dots, display.pitch) if display else (_USUAL_DOTS, _USUAL_PITCH)
        pitch_um = parse_pitch_um(own_pitch if pitch is None else length_text(pitch, "pitch"), where="pitch")
        dots = (
            dots_near(own_dots, display.multiple if display else 1, pitch_um) if dots is None else _whole(dots, "dots")
        )
        dot_nm = max(1, round(pitch_um * NM_PER_UM / max(1, dots)))
        made: dict[str, str | int | float] = {
            "author": "maskfab",
            "command": command
            or f"maskfab.Opening.shape({kind!r}, dots={dots}, pitch={pitch!r}, clear_dots={clear_dots})",
            "version": __version__,
        }
        emitters = None
        if display is not None:
            if dots % display.multiple:
                what = f"dots = {dots} is not a multiple of {display.multiple}, as those of {kind} must be"
                near = dots_near(dots, display.multiple, pitch_um)
                raise JobError("MF104", what, where="dots", cure=f"Use {near} dots of {pitch_um / near:.6g} um")
            mask, emitters = display.draw(dots, dict(lengths or {}))
            made.update(emitter_layouts.source_facts(display, changed=changed))
        elif lengths:
            cure = f"Draw one of {', '.join(emitter_layouts.DISPLAYS)}"
            raise JobError("MF102", f"{kind} has no lengths", where="lengths", cure=cure)
        elif kind == "stripe":
            mask = shapes.stripe(dots, width_dots, clear_dots)
        elif clear_dots is None:
            what = f"{kind} needs a number of clear dots"
            raise JobError("MF105", what, where="clear_dots", cure="Add 90 clear dots")
        elif kind == "blobs":
            mask = shapes.blobs(dots, clear_dots, size_ratio=size_ratio, aspect=aspect, exponent=exponent)
        else:
            mask = shapes.diamond_discs(dots, clear_dots)
        return cls(called, mask, dot_nm, made, emitters)

    @classmethod
    def _checked(cls, name: str, mask: Mask, pitch: Length, made: dict[str, str | int | float], where: str) -> Self:
        dot_nm = _dot_nm(pitch, len(mask), f"{where}: pitch")
        return cls.of_model(opening_file.checked(name, mask, dot_nm, made, where))

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.array(self.mask, dtype=dtype, copy=copy)

    def __dlpack__(self, **options: Any) -> Any:
        """The mask, for torch.tensor and other libraries of arrays; a copy, which may be written to."""
        copy: NDArray[Any] = self.mask.copy()
        return copy.__dlpack__(**options)

    def __dlpack_device__(self) -> tuple[int, int]:
        return self.mask.__dlpack_device__()

    @classmethod
    def of_model(cls, opening: model.Opening) -> Self:
        """An opening of the vocabulary, which has no pictures and is no array, as one of this class."""
        if isinstance(opening, cls):
            return opening
        return cls(opening.name, opening.mask, opening.dot_nm, opening.provenance, opening.emitters)

    @property
    def pitch_um(self) -> float:
        """Side of the pixel at its nominal size, without a gutter."""
        return self.dots * self.dot_nm / NM_PER_UM

    @checked_arguments
    @one_thread
    def reduced(
        self,
        clear_dots: int,
        camera: Camera | None = None,
        *,
        tiling: Literal["random", "periodic"] = "random",
        images: str | Path | None = None,
        progress: Progress = silent,
    ) -> Opening:
        """The opening with fewer clear dots, to compare it at equal light with one that has no more.

        One after the other the dot is closed that restored photographs are expected to miss least.

        Args:
            clear_dots: how many stay clear.
            camera: that looks through it; by default that of protocol F1.
            tiling: how pixels are turned.
            images: folder of photographs that count; synthetic scenes if None.
            progress: told where the work stands.

        Raises:
            JobError: MF104 for more clear dots than there are, MF105 for another tiling, MF135 for dots too coarse for
                the camera's stop.
            OpeningError: MF203 for none.
            SourceError: for photographs that cannot be read.
        """
        from maskfab.api.camera import protocol_f1
        from maskfab.camera import scenes
        from maskfab.camera.scenes import folder
        from maskfab.camera.stop_cells import PhotoCamera, camera_line
        from maskfab.designs.search.scan import reduced_opening, require_count

        if tiling not in ("random", "periodic"):
            cure = "Use random or periodic"
            raise JobError("MF105", f"no opening is reduced for the tiling {tiling!r}", where="tiling", cure=cure)
        count = _whole(clear_dots, "clear_dots")
        require_count(self.mask, count)
        stated = "" if camera is None else f", camera={camera_line(camera.model)!r}"
        stated += "" if images is None else f", images={str(images)!r}"
        opening = reduced_opening(
            self,
            count,
            PhotoCamera.of((camera or protocol_f1()).model),
            scenes.bundled() if images is None else folder(Path(images)).photographs,
            f"maskfab.Opening.reduced({count}, tiling={tiling!r}{stated})",
            periodic=tiling == "periodic",
            progress=progress,
        )
        return Opening.of_model(opening)

    @checked_arguments
    def save(self, path: str | Path) -> Path:
        """Write it as a readable file (.toml); an earlier file is replaced."""
        from maskfab.base.folders import write_text

        target = Path(path)
        if target.suffix.lower() != ".toml":
            problem = f"no opening is written with the suffix {target.suffix!r}"
            raise OutputError("MF430", problem, where=str(target), cure="Use .toml")
        write_text(target, opening_file.opening_text(self))
        return target

    def plot(self) -> Drawing:
        """The unit cell: clear is white, chrome dark."""
        from maskfab.report.figures import die as die_figures

        return die_figures.opening(self)

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        return (
            f"<Opening {self.name}: {self.dots} x {self.dots} dots, {self.open_ratio:.1%} clear, {self.pitch_um:g} um>"
        )


def mask_of(given: ArrayLike, where: str, threshold: float | None = None) -> Mask:
    """Clear dots of an array of a caller; errors as for :func:`maskfab.mask.opening_masks.from_array`."""
    cure = "Name the value from which on a dot is clear: Opening.of(array, pitch, threshold={middle})"
    return decode.from_array(given, where, threshold=threshold, cure=cure)


@checked_arguments
def read_opening(
    source: str | Path | ArrayLike,
    *,
    pitch: Length | None = None,
    dots: int | None = None,
    layer: str | None = None,
    cell: str | None = None,
    name: str | None = None,
) -> Opening:
    """An opening from a file (.toml .txt .csv .png .tif .exr .npy .gds .oas .dxf) or an array.

    Args:
        source: path or array; images are clear where they are bright, one pixel for each dot.
        pitch: side of the pixel; all but .toml need it.
        dots: dots along the pixel; layouts need it.
        layer: of a layout; needed where it has several.
        cell: of a layout; needed where it has several on top.
        name: of the opening; by default the file's own, or its stem.

    Raises:
        SourceError: MF301 to MF323 for a file that cannot be read.
        OpeningError: MF201 to MF206 for one that is no opening.
        JobError: MF105 if pitch or dots are missing; MF103 to MF107 for the pitch.
    """
    if not isinstance(source, str | Path):
        return Opening.of(source, _stated(pitch, "pitch", "the array"), name=name or "opening")
    path = Path(source)
    if path.suffix.lower() == ".toml":
        opening = opening_file.load_opening(path, dots=dots, name=name)
        return Opening.of_model(opening if pitch is None else _repitched(opening, pitch))
    from maskfab.mask.formats.table import LAYOUT_SUFFIXES  # slow to load, with every format

    if suffix_of(path) in LAYOUT_SUFFIXES:
        wanted = _whole(_stated(dots, "dots", path.name), "dots")
        dot_nm = _dot_nm(_stated(pitch, "pitch", path.name), wanted, "read_opening: pitch")
        return Opening.of_model(
            opening_file.load_opening(path, dots=wanted, dot_nm=dot_nm, layer=layer, cell=cell, name=name)
        )
    opening = opening_file.load_opening(path, dots=dots, dot_nm=1, name=name)
    return Opening.of_model(_repitched(opening, _stated(pitch, "pitch", path.name)))


def dots_near(usual: int, multiple: int, pitch_um: float) -> int:
    """The multiple of a number nearest to the usual dots that are whole nanometres of a pitch, if there is one."""
    near = range(-(-usual // (2 * multiple)) * multiple, 2 * usual + 1, multiple)
    whole = [dots for dots in near if abs(pitch_um * NM_PER_UM / dots % 1 - 0.5) > 0.5 - 1e-6]
    return min(whole or [usual], key=lambda dots: (abs(math.log(dots / usual)), dots))


def _repitched(opening: model.Opening, pitch: Length) -> model.Opening:
    return replace(opening, dot_nm=_dot_nm(pitch, opening.dots, "read_opening: pitch"))


def _dot_nm(pitch: Length, dots: int, where: str) -> int:
    return opening_file.dot_of_pitch(parse_pitch_um(length_text(pitch, "pitch", where), where=where), dots, where=where)


def _stated(value: Any, key: str, source: str) -> Any:
    if value is None:
        what = f"{key} is not given, and {os.path.basename(source)} does not state it"
        cure = 'Add pitch = "168 um"' if key == "pitch" else "Add dots = 21"
        raise JobError("MF105", what, where=f"read_opening: {key}", cure=cure)
    return value


def _whole(value: object, key: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise JobError("MF105", f"{key} = {value!r} is not a whole number", where=key, cure=f"Write {key} = 21")
    return int(value)
