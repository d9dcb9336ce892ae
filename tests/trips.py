"""A written file read back and compared with its plate."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from klayout import db

from maskfab.base.model import Plate
from maskfab.mask.comparison.files import read_mask
from maskfab.mask.comparison.roundtrip import RoundTrip, compare_layout


def roundtrip(plate: Plate, design: db.Layout, path: Path, **options: Any) -> RoundTrip:
    """The comparison of a file, with the options of :func:`maskfab.mask.comparison.roundtrip.compare_layout`."""
    return compare_layout(plate, design, read_mask(path), path, **options)
