"""Mask shops, and what is sent to them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import overload

from maskfab.api.jobs import AnyJob, job_of
from maskfab.delivery.pack import Package, pack
from maskfab.errors import JobError
from maskfab.jobfile.shop_profile import FORMATS, Format, Shop
from maskfab.mask_shops.profiles import load_shop, shop_names
from maskfab.progress import Progress, silent
from maskfab.threads import one_thread


@overload
def shops(name: None = None) -> tuple[Shop, ...]: ...
@overload
def shops(name: str) -> Shop: ...
def shops(name: str | None = None) -> Shop | tuple[Shop, ...]:
    """All mask shops with published rules, or the rules of one.

    Examples:
        >>> import maskfab as mf
        >>> mf.shops("photoplotstore").accepts.formats[0]
        'gdsii'

    Args:
        name: of a shop, or the path of a profile (.toml).

    Raises:
        OutputError: MF420 or MF421 for the profile.
    """
    return tuple(load_shop(each) for each in shop_names()) if name is None else load_shop(name)


@one_thread
def package(
    job: AnyJob,
    shop: str,
    out: str | Path,
    *,
    formats: Sequence[str] = (),
    force: bool = False,
    progress: Progress = silent,
) -> Package:
    """Pack a plate for a mask shop: mask files, order sheet, drawing, job, certificate; only if it keeps the rules.

    Args:
        job: a plate, a loaded job, or the path of a job file.
        shop: its name, or the path of a profile.
        out: the package (.zip); it appears when it is complete.
        formats: of the mask files; by default the shop's first.
        force: replace an earlier file.
        progress: told where the work stands.

    Raises:
        OutputError: MF401 or MF402 for the place, MF420 or MF421 for the shop.
        JobError: MF105 for a format that there is not; else as for the job.
    """
    profile, sent = load_shop(shop), formats_of(formats)
    return pack(job_of(job), profile, out, sent, force=force, progress=progress)


def formats_of(asked: Sequence[str]) -> tuple[Format, ...]:
    """Formats by their names, in the order of all.

    Raises:
        JobError: MF105 for one that there is not.
    """
    for each in asked:
        if each not in FORMATS:
            cure = f"Choose among {', '.join(FORMATS)}"
            raise JobError("MF105", f"there is no format {each!r}", where="format", cure=cure)
    return tuple(each for each in FORMATS if each in asked)
