"""The names of the numbers that a sweep can ask of a case, by the work that finds them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from types import MappingProxyType

from maskfab.errors import JobError

_FRACTIONS = ("mtf50", "mtf30", "mtf10")
_READINGS = ("fused", "open")
_FOUND_BY: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "open ratio": ("open_ratio",),
        "mtf": ("auc_radial_min", *_FRACTIONS, *(f"{name}_per_pixel" for name in _FRACTIONS)),
        "restoration": ("wiener_worst30", "wiener_noise_gain"),
        "features": ("min_feature", "min_space", "written_min_feature", "written_min_space"),
        "psf as written": tuple(
            f"written_{name}_{reading}"
            for name in ("open_ratio", "psf_difference", "psf_shape")
            for reading in _READINGS
        ),
        "mtf as written": tuple(
            f"written_{name}_{reading}" for name in ("auc_radial_min", "mtf50") for reading in _READINGS
        ),
        "scatter": tuple(f"written_scattered_{reading}" for reading in _READINGS),
        "surrogate": ("expected_psnr",),
        "footprint": ("led_footprint_largest", "led_footprint_bound"),
        "display": ("display_fits", "led_footprint", "circuit_room"),
        "scene": ("scene_psf_change", "plan_error", "depth_residual", "field_residual", "depth_change"),
        "photographs": ("restored_psnr",),
    }
)
WORKS: Mapping[str, str] = MappingProxyType({name: work for work, names in _FOUND_BY.items() for name in names})
"""Work that finds a quantity, by the quantity's name, the cheapest first."""

_BY_PSF = frozenset({"psf as written", "scatter", "scene"})
"""Works that look at the camera's window."""


def by_psf(names: Sequence[str]) -> bool:
    """Whether any of the quantities is of the PSF in the camera's window."""
    return not _BY_PSF.isdisjoint(WORKS[name] for name in names)


def require_known(names: Sequence[str], where: str) -> None:
    """Refuse quantities that no case has.

    Raises:
        JobError: MF161, with those that look like it.
    """
    for name in names:
        if name not in WORKS:
            near = get_close_matches(name, WORKS, n=3) or list(WORKS)
            raise JobError(
                "MF161", f"a sweep cannot find the quantity {name!r}", where=where, cure=f"Use one of {', '.join(near)}"
            )
    if len(set(names)) < len(names):
        raise JobError("MF161", "a quantity is named twice", where=where, cure="Name each once")
