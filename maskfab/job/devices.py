"""Devices with a camera behind their display: what was published of them, and what was not.

A device answers the questions of a brief as far as pages tell; the rest is named and asked for, and never filled in.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from functools import cache
from types import MappingProxyType

from pydantic import Field

from maskfab.base import resources
from maskfab.base.errors import JobError
from maskfab.base.units import parse_length_um
from maskfab.job.values import Length, Section

_NEEDED = {"dpi": "density over the camera", "focal": "focal length", "f_number": "f-number", "pixel": "camera's pixel"}
_ALSO = (
    "what is clear of a display's pixel",
    "its circuits and lines",
    "the gap from display to lens",
    "the full well",
)
"""Published of none of them."""


class Device(Section):
    """A display with its camera; None where no page was found that tells a number."""

    title: str
    dpi: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    """Pixels of the display over the camera in an inch."""
    focal: Length | None = None
    f_number: float | None = Field(default=None, gt=0, allow_inf_nan=False)
    pixel: Length | None = None
    """Of the camera, several taken as one where it is used so."""
    field_deg: float | None = Field(default=None, gt=0, lt=180)
    day: str
    """On which the pages were read."""
    source: str

    @property
    def missing(self) -> tuple[str, ...]:
        """Everything that no page tells, in words: what a job needs, and what would make it better."""
        return (*(words for key, words in _NEEDED.items() if getattr(self, key) is None), *_ALSO)


@cache
def devices() -> Mapping[str, Device]:
    """The bundled list, by the names that answers give."""
    text = resources.path("layouts/cameras/devices.toml").read_text(encoding="utf-8")
    return MappingProxyType({name: Device.model_validate(table) for name, table in tomllib.loads(text).items()})


def of_device(answers: Mapping[str, object]) -> dict[str, object]:
    """Answers in which ``device`` is spelt out: its density as ``dpi``, its lens and pixel as ``camera``.

    Half of its field of view is ``field``. Answers to ``pitch``, ``dpi`` or ``field`` stand, and to ``camera``: all its
    numbers, or the focal length alone where the rest is published.

    Raises:
        JobError: MF105 for a device that is not in the list, or of which a number is neither published nor answered.
    """
    stated = dict(answers)
    name = str(stated.pop("device")).strip().lower()
    if name not in devices():
        near = get_close_matches(name, devices(), n=1, cutoff=0.4)
        cure = f"{f'Did you mean {near[0]!r}? ' if near else ''}The list: {', '.join(devices())}"
        raise JobError("MF105", f"there is no device {name!r}", where="answers: device", cure=cure)
    device = devices()[name]
    if device.dpi is not None and not stated.keys() & {"dpi", "pitch"}:
        stated["dpi"] = f"{device.dpi:g} dpi"
    if device.field_deg is not None:
        stated.setdefault("field", f"{device.field_deg / 2:g} deg")
    focal = device.focal
    if "camera" in stated:
        try:
            focal = parse_length_um(str(stated["camera"]))
        except JobError:  # which is all of its numbers, or a name of the list of cameras
            return stated
    lens = {"focal": focal, "f_number": device.f_number, "pixel": device.pixel}
    absent = [key for key, value in lens.items() if value is None]
    if absent:
        known = "2.4 mm" if focal is None else f"{focal:g} um"
        rest = "" if absent == ["focal"] else f" f/{device.f_number or 2:g} {device.pixel or 1.12:g} um"
        what = f"no page tells the {' and '.join(_NEEDED[key] for key in absent)} of {device.title}"
        cure = f"Answer camera, too, such as camera = '{known}{rest}'"
        raise JobError("MF105", what, where=f"answers: device = {name}", cure=cure)
    lengths = {"focal": f"{focal:.10g} um", "pixel": f"{device.pixel:.10g} um"}
    stated["camera"] = {"title": device.title, "source": device.source, "f_number": device.f_number, **lengths}
    return stated
