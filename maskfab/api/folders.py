"""Folders of photographs that a user names."""

from __future__ import annotations

from pathlib import Path

from maskfab.base.errors import JobError
from maskfab.camera.scenes import Folder, folder


def given_folder(images: str | Path | None, white: float | None, *, whole: bool = False) -> Folder | None:
    """The photographs of a folder; None where none is named, and scenes are drawn.

    Args:
        images: the folder.
        white: light that is white in photographs that hold light, EXR and HDR; None where nobody states it.
        whole: take whole photographs rather than their middle.

    Raises:
        JobError: MF105 for a white that nothing is measured by, or whole photographs of none; as
            :func:`maskfab.camera.scenes.folder`.
        SourceError: MF301 without photographs in it.
    """
    if images is not None:
        return folder(Path(images), white, whole=whole)
    if white is not None:
        raise JobError(
            "MF105",
            f"light of {white:g} is stated as white, and the drawn scenes have a white of their own",
            where="white",
            cure="Add images, a folder of EXR or HDR photographs, or remove white",
        )
    if whole:
        raise JobError(
            "MF105",
            "whole photographs are asked for, and scenes are drawn",
            where="whole",
            cure="Add images, a folder of photographs, or remove whole",
        )
    return None
