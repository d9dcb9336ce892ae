"""Entries for a bibliography: the program that made a plate, and the work that it rests on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from maskfab.base import __version__
from maskfab.base.checks import checked_arguments
from maskfab.base.folders import read_manifest

_PROGRAM = """\
@software{{maskfab,
  title   = {{maskfab: photomask plates for under-panel cameras}},
  version = {{{version}}},{note}
}}"""
_PAPER = """\
@article{yang2021display,
  author  = {Yang, Anqi and Sankaranarayanan, Aswin C.},
  title   = {Designing Display Pixel Layouts for Under-Panel Cameras},
  journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},
  year    = {2021}
}"""


@dataclass(frozen=True)
class Citation:
    """Entries for a bibliography.

    Attributes:
        program: of maskfab in the version that is cited.
        paper: of the work whose experiment it is for.
    """

    program: str
    paper: str

    def __str__(self) -> str:
        return f"{self.program}\n\n{self.paper}"

    def to_dict(self) -> dict[str, str]:
        """The entries."""
        return {"program": self.program, "paper": self.paper}


@checked_arguments
def cite(directory: str | Path | None = None) -> Citation:
    """Entries in BibTeX of maskfab, and of the paper whose experiment it is for.

    Args:
        directory: a finished run, whose version and job are cited; None for this installation.

    Raises:
        OutputError: MF403 if it is none.
    """
    if directory is None:
        return Citation(_PROGRAM.format(version=__version__, note=""), _PAPER)
    manifest = read_manifest(Path(directory))
    note = f"\n  note    = {{job {str(manifest.get('job_hash'))[:16]}}},"
    return Citation(_PROGRAM.format(version=manifest["maskfab_version"], note=note), _PAPER)
