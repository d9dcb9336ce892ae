"""An opening laid out over many pixels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Self

from numpy.typing import ArrayLike

from maskfab.api.lengths import Length, length_text
from maskfab.api.opening import Opening, mask_of
from maskfab.base import model
from maskfab.base.cell_size import CellSize
from maskfab.base.checks import checked_arguments
from maskfab.base.errors import JobError
from maskfab.base.extras import require
from maskfab.base.model import Tiling
from maskfab.base.units import NM_PER_UM, parse_length_um, parse_pitch_um, to_nm
from maskfab.job.die import DieSection, check_die, check_seed, even_nm
from maskfab.job.faults import parse_section
from maskfab.job.values import check_name, um_text
from maskfab.mask.opening_file import checked
from maskfab.mask.panels import CellMap, check_alike, panel_shape, shifted_openings, tiled

if TYPE_CHECKING:
    import cadquery
    import trimesh

    from maskfab.mask.formats.format import Stack
    from maskfab.report.figures.sheet import Drawing


_WHERE = "Panel.tile"


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Panel(model.Panel):
    """An opening tiled over a square, with an opaque gutter round every pixel.

    Examples:
        >>> import maskfab as mf
        >>> bar = mf.Opening.bar(dots=21, size=(15, 7), pitch="168 um")
        >>> panel = mf.Panel.tile(bar, "random", seed=1, size="4.4 mm")
        >>> panel.orientations.shape, panel.size_nm
        ((26, 26), (4368000, 4368000))

    Attributes:
        section: the panel as a [[die]] of a job file states it.
        held: its openings as they were given; those that a map moves are drawn moved.
        cells: its map, for the tiling of that name.
    """

    section: DieSection
    held: tuple[Opening, ...]
    cells: CellMap | None = None

    @classmethod
    @checked_arguments
    def tile(
        cls,
        opening: model.Opening | ArrayLike,
        tiling: str | CellMap = Tiling.PERIODIC,
        *,
        seed: int | None = None,
        size: Length | None = None,
        pitch: Length | None = None,
        gutter: Length = 0.0,
        others: Sequence[model.Opening] = (),
        threshold: float | None = None,
        name: str | None = None,
    ) -> Self:
        """Lay an opening out.

        Args:
            opening: the clear shape of a pixel; or, with ``pitch``, an array of it as :meth:`maskfab.Opening.of` takes.
            tiling: how pixels are turned: periodic, random, paper4, flips, rot90, rot90flip, blue_noise or hexagonal;
                or a map, such as that of a design, in the middle.
            seed: of a random tiling, and of what lies beyond a map.
            size: side of the square to be filled with whole pixels; by default that of the map.
            pitch: side of a pixel, gutter included, or ``"300 dpi"``; by default the opening's own dots and the gutter.
            gutter: opaque space round every pixel.
            others: further openings, of which every pixel draws one.
            threshold: of a grey array, the value from which on a dot is clear.
            name: of the opening of an array; "opening" by default.

        Raises:
            JobError: MF103 to MF107 and MF156 for lengths, MF105 for an unknown tiling, and for a threshold or a name
                beside an opening, MF108 where no pixel fits, MF111 without a seed, MF115 for too many pixels, MF122 for
                a map that does not fit.
            OpeningError: as :meth:`maskfab.Opening.of`, for an array.
        """
        if isinstance(opening, model.Panel):
            what = "a panel is laid out already"
            raise JobError("MF105", what, where=_WHERE, cure="Give an opening, such as panel.held[0]")
        gap_um = parse_length_um(length_text(gutter), where=f"{_WHERE}: gutter", zero_allowed=True)
        gutter_nm = even_nm(gap_um, where=f"{_WHERE}: gutter", name="gutter")
        drawn: model.Opening | None = None
        if isinstance(opening, model.Opening):
            drawn, mask = opening, opening.mask
            for key, value in {"threshold": threshold, "name": name}.items():
                if value is not None:
                    cure = f"Leave {key} out"
                    raise JobError("MF105", f"{key} goes with an array", where=f"{_WHERE}: {key}", cure=cure)
        else:
            mask = mask_of(opening, f"{_WHERE}: opening", threshold)
        if pitch is not None:
            place = f"{_WHERE}: pitch"
            pitch_um = parse_pitch_um(length_text(pitch, "pitch", place), where=place)
            pixel = CellSize.of_pitch(pitch_um, len(mask), gutter_nm, where=place)
        elif drawn is not None:
            pixel = CellSize(drawn.dots, drawn.dot_nm, gutter_nm)
        else:
            cure = 'Add pitch = "168 um", or make an Opening'
            raise JobError("MF105", "an array does not state the pitch of its pixel", where=_WHERE, cure=cure)
        unit = drawn or checked(name or "opening", mask, pixel.dot_nm, {}, f"{_WHERE}: opening")
        cells = tiling if isinstance(tiling, CellMap) else None
        if cells is not None and size is None:
            rows, columns = cells.cells.shape
            size = max(rows, columns) * pixel.pitch_um
            if seed is None and (cells.beyond is not None or panel_shape(cells, rows, rows) == (rows, columns)):
                seed = 0  # nothing that lies beyond the map is drawn
        held = tuple(Opening.of_model(one) for one in (unit, *others))
        stated = {
            "name": unit.name,
            "label": unit.name,
            "opening": unit.name,
            "others": tuple(other.name for other in others) or None,
            "dot": um_text(pixel.dot_nm / NM_PER_UM),
            "gutter": um_text(gap_um),
            "tiling": Tiling.MAP if cells is not None else tiling,
            "map": None if cells is None else cells.name,
            "seed": seed,
            "size": None if size is None else length_text(size, "size", f"{_WHERE}: size"),
        }
        section = parse_section(DieSection, stated, where=_WHERE)
        if section.size is None:
            raise JobError("MF105", "there is no size", where=_WHERE, cure='Add size = "4.4 mm"')
        check_die(section, _WHERE)
        check_seed(section, _WHERE)
        check_alike(held, f"{_WHERE}: others")
        laid = held if cells is None else shifted_openings(cells, held, where=f"{_WHERE}: map")
        side_nm = to_nm(section.size, where=f"{_WHERE}: size", name="size")
        panel = tiled(section, laid, side_nm, cells, where=_WHERE)
        own = {field.name: getattr(panel, field.name) for field in fields(panel)}
        return cls(**own, section=section, held=held, cells=cells)

    def renamed(self, names: Mapping[str, str]) -> Self:
        """The panel with other names of its openings, by those that they have."""
        other = {name: check_name(new, where="Panel.renamed") for name, new in names.items()}
        held = tuple(replace(one, name=other.get(one.name, one.name)) for one in self.held)
        drawn = [replace(one, name=other.get(one.name, one.name)) for one in (self.opening, *self.others)]
        stated = {"opening": held[0].name, "others": tuple(one.name for one in held[1:]) or None}
        label = other.get(self.section.label, self.section.label)
        section = self.section.model_copy(update={**stated, "label": label})
        return replace(self, opening=drawn[0], others=tuple(drawn[1:]), held=held, section=section)

    @property
    def side_nm(self) -> int:
        """Side of the square that was to be filled."""
        assert self.section.size is not None
        return to_nm(self.section.size)

    @checked_arguments
    def plot(self, cells: int = 6) -> Drawing:
        """Some pixels in the middle, with the gutters between them.

        Raises:
            JobError: MF104 for no pixel.
        """
        if cells < 1:
            raise JobError("MF104", f"cells = {cells} is below 1", where="Panel.plot: cells", cure="Give 1 or more")
        from maskfab.report.figures import die as die_figures

        return die_figures.panel_close_up(self, cells)

    @checked_arguments
    def to_cadquery(self, chrome: Length = "100 nm", glass: Length = "2.3 mm") -> cadquery.Assembly:
        """Glass and the chrome of every pixel as an assembly in millimetres, the panel's middle at the origin.

        Args:
            chrome: thickness of the film; more than there is makes it visible.
            glass: thickness of the substrate.

        Raises:
            JobError: MF103 or MF104 for a thickness; MF152 without cadquery.
            OutputError: MF410 for pixels without chrome, MF412 for a panel of too many vertices or pixels.
        """
        require("solid", what="an assembly", loads=("OCP",))
        from maskfab.mask.formats.step import cadquery_assembly

        return cadquery_assembly(self._die(), _stack(chrome, glass))

    @checked_arguments
    def to_trimesh(self, chrome: Length = "100 nm", glass: Length = "2.3 mm") -> trimesh.Scene:
        """A scene of two closed meshes in millimetres, ``GLASS`` and ``FILM``, the chrome of all pixels.

        Where openings touch by a corner the chrome between them is a tenth of a dot wide, for a surface of no width is
        not closed. Arguments and errors as :meth:`to_cadquery`; MF436 for dots below 100 nm that touch so.
        """
        require("solid", what="a scene of meshes")
        from maskfab.mask.formats.step import trimesh_scene

        return trimesh_scene(self._die(), _stack(chrome, glass))

    def _die(self) -> model.Die:
        return model.Die("PANEL", self.held[0].name, self, (0, 0), self.side_nm)

    def _repr_svg_(self) -> str:
        return self.plot().svg()

    def __repr__(self) -> str:
        rows, columns = self.orientations.shape
        width, height = (side / 1e6 for side in self.size_nm)
        return (
            f"<Panel of {self.held[0].name}: {self.tiling}, {columns} x {rows} pixels of "
            f"{self.pitch_nm / NM_PER_UM:g} um, {width:g} x {height:g} mm, {self.open_ratio:.1%} clear>"
        )


def _stack(chrome: Length, glass: Length) -> Stack:
    from maskfab.mask.formats.format import Stack

    film_um, glass_um = (
        parse_length_um(length_text(value, "glass" if name == "glass" else ""), where=f"Panel: {name}")
        for name, value in (("chrome", chrome), ("glass", glass))
    )
    return Stack(film_um * NM_PER_UM, glass_um * NM_PER_UM)
