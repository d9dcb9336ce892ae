"""Restored photographs as results: in memory, as files, in words."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from maskfab.base import __version__
from maskfab.base.arrays import Singles
from maskfab.base.folders import check_target, staged, write_mark
from maskfab.camera.photo import ChartMatrix
from maskfab.camera.registration import RegisteredPhoto
from maskfab.mask.formats.exr import Fact, write_exr, write_png

DOCUMENT = "restore.json"


@dataclass(frozen=True, eq=False, repr=False)
class RestoredPhoto:
    """One photograph, restored.

    Attributes:
        name: of its file, without suffix.
        sha256: of its file.
        picture: float32 [3, rows, columns] linear sRGB within 0 to 1, row 0 on top.
        full: bool [rows, columns], where a colour of the photograph was full.
        blur: sentences on the blur that was undone.
        restorer: that was used.
        epsilon: strength of its prior.
        electrons: of white, by which its noise is known.
        read_noise: in electrons.
        clipped: share of its values that were full.
        told: sentences on how it was read.
    """

    name: str
    sha256: str
    picture: Singles
    full: NDArray[np.bool_]
    blur: tuple[str, ...]
    restorer: str
    epsilon: float
    electrons: float
    read_noise: float
    clipped: float
    told: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """All but the picture."""
        _, rows, columns = self.picture.shape
        return {
            "name": self.name,
            "sha256": self.sha256,
            "rows": rows,
            "columns": columns,
            "blur": list(self.blur),
            "restorer": self.restorer,
            "epsilon": self.epsilon,
            "electrons_of_white": self.electrons,
            "read_noise_e": self.read_noise,
            "clipped": self.clipped,
            "told": list(self.told),
        }

    @property
    def facts(self) -> dict[str, Fact]:
        """For the header of a picture."""
        return {
            "restorer": self.restorer,
            "epsilon": self.epsilon,
            "photo_sha256": self.sha256,
            "blur": "; ".join(self.blur),
        }


@dataclass(frozen=True, eq=False, repr=False)
class Restoration:
    """Restored photographs.

    Attributes:
        photos: in the order of their files.
        brought: each but the first as it lies on the first, if that was asked for.
        chart: colours by a chart in the first, if one was stated.
    """

    photos: tuple[RestoredPhoto, ...]
    brought: tuple[RegisteredPhoto, ...] = field(default=())
    chart: ChartMatrix | None = None

    def to_dict(self) -> dict[str, Any]:
        """All but the pictures."""
        return {
            "maskfab_version": __version__,
            "photos": [each.to_dict() for each in self.photos],
            **({"registered": [each.to_dict() for each in self.brought]} if self.brought else {}),
            **({} if self.chart is None else {"chart": self.chart.to_dict()}),
        }

    def save(self, out: str | Path, *, force: bool = False) -> list[Path]:
        """Write ``NAME.png`` (8-bit sRGB) and ``NAME.exr`` (linear sRGB, half) of each, and ``restore.json``.

        Pictures that were brought onto the first are ``NAME_on_FIRST.png`` and ``.exr``.

        Raises:
            OutputError: MF401, MF402 if the directory cannot be written or is not empty.
        """
        place = check_target(Path(out), force=force)
        known = {each.name: each.facts for each in self.photos}
        pictures = [(each.name, each.picture, each.facts) for each in self.photos]
        pictures += [(f"{each.name}_on_{each.onto}", each.picture, known[each.name]) for each in self.brought]
        with staged(place) as folder:
            for name, picture, facts in pictures:
                light = picture[:, ::-1].astype(np.float64)
                write_png(light, folder / f"{name}.png")
                write_exr(light, folder / f"{name}.exr", facts)
            document = json.dumps(self.to_dict(), indent=1, ensure_ascii=False, allow_nan=False)
            (folder / DOCUMENT).write_text(document + "\n", encoding="utf-8")
            write_mark(folder, None)
            names = sorted(each.name for each in folder.iterdir())
        return [Path(out) / name for name in names]

    def __str__(self) -> str:
        lines = []
        for each in self.photos:
            _, rows, columns = each.picture.shape
            lines.append(
                f"{each.name}: {columns} x {rows}, restored by {each.restorer}, epsilon {each.epsilon:.3g}; "
                f"{100 * each.clipped:.2g} % full"
            )
            lines += [f"  blur: {sentence}" for sentence in each.blur]
            lines += [f"  {sentence}" for sentence in each.told]
        if self.chart is not None:
            lines += [str(self.chart), *(f"  {sentence}" for sentence in self.chart.left_out)]
        return "\n".join([*lines, *map(str, self.brought)])
