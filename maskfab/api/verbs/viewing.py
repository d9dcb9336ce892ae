"""The plate of a finished run as one page to look into."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from maskfab.base.checks import checked_arguments
from maskfab.base.errors import OutputError
from maskfab.base.folders import check_file, write_text
from maskfab.report.pages.viewer import shown_run, viewer_page


@dataclass(frozen=True, repr=False)
class View:
    """A page that shows a plate.

    Attributes:
        path: of the page.
        mask_file: name of the mask file whose polygons it shows.
        sha256: of that file.
        bytes: of the page.
    """

    path: Path
    mask_file: str
    sha256: str
    bytes: int

    def to_dict(self) -> dict[str, Any]:
        """Its attributes."""
        return {"page": str(self.path), "mask_file": self.mask_file, "sha256": self.sha256, "bytes": self.bytes}

    def __str__(self) -> str:
        return f"{self.path}: {self.mask_file}, SHA-256 {self.sha256}, in {self.bytes / 1e6:.1f} MB"

    def __repr__(self) -> str:
        return str(self)


@checked_arguments
def view(directory: str | Path, out: str | Path | None = None, *, force: bool = False) -> View:
    """Make one page, complete in itself, to look into the plate of a finished run with any browser.

    Its polygons are those of the run's first mask file, read back; nothing is flattened.

    Examples:
        >>> import maskfab as mf
        >>> print(mf.view("build/upc12"))                                              # doctest: +SKIP

    Args:
        directory: of a finished run; nothing is written into it.
        out: the page; by default beside the directory, of its name.
        force: replace a file that is there.

    Raises:
        OutputError: MF401 or MF402 if the page cannot be written, MF403 for no finished run, MF407 for a file that was
            changed since, MF409 for a run without a mask file of polygons.
        SourceError: if the mask file cannot be read.
    """
    folder = Path(os.path.realpath(directory))
    target = folder.with_name(f"{folder.name}.html") if out is None else Path(out)
    if folder in Path(os.path.realpath(target)).parents:
        raise OutputError(
            "MF401",
            f"{target} lies in the finished run, whose manifest does not know it",
            where="--out",
            cure="Give --out a path beside the directory",
        )
    check_file(target, force=force)
    run = shown_run(folder)
    page = viewer_page(run)
    write_text(target, page, replace=force)
    return View(target, run.file["path"], run.file["sha256"], len(page.encode()))
