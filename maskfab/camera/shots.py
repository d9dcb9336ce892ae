"""Restored photographs to look at, beside the truth: part of what a protocol scores as a whole."""

from __future__ import annotations

from dataclasses import dataclass

from maskfab.base.arrays import Singles
from maskfab.camera.photographs import Photograph
from maskfab.camera.scores import Score
from maskfab.errors import JobError


@dataclass(frozen=True)
class Crop:
    """Rows and columns in the middle of the sensor, in pixels."""

    rows: int
    columns: int

    def of(self, picture: Singles) -> Singles:
        """That part of a picture [3, rows, columns], a copy.

        Raises:
            JobError: MF104 if the picture is smaller, or the crop is empty.
        """
        rows, columns = picture.shape[1:]
        if not (0 < self.rows <= rows and 0 < self.columns <= columns):
            raise JobError(
                "MF104",
                f"a crop of {self.columns} x {self.rows} pixels of a picture of {columns} x {rows}",
                where="crop",
                cure="Cut out 1 pixel or more, and no more than there are",
            )
        top, left = (rows - self.rows) // 2, (columns - self.columns) // 2
        return picture[:, top : top + self.rows, left : left + self.columns].copy()


@dataclass(frozen=True, eq=False)
class Shot:
    """A photograph through a design, restored.

    Attributes:
        score: of the whole frame and of the inner one.
        picture: part of it, float32 [3, rows, columns] within 0 to 1, row 0 on top; code values as the scene's.
    """

    score: Score
    picture: Singles


def truth_of(scene: Photograph, crop: Crop) -> Singles:
    """The crop of the scene itself.

    Raises:
        JobError: as :meth:`Crop.of`.
    """
    return crop.of(scene.margin.sensor(scene.values))
