"""sRGB codes and the light they stand for, CIE L*a*b* and ΔE of 1976, and where a pixel's luminance comes from."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from maskfab.base.arrays import Floats, Singles
from maskfab.base.model import Emitters

Reals = TypeVar("Reals", Singles, Floats)

# IEC 61966-2-1: linear sRGB to CIE 1931 XYZ; its white, (1, 1, 1), is D65.
XYZ_OF_RGB = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
XYZ_OF_RGB.flags.writeable = False

LUMINANCE = XYZ_OF_RGB[1]
"""Share of the luminance of white that red, green and blue have; also ITU-R BT.709-6, item 3.3."""

JUST_NOTICEABLE = 2.3
"""ΔE of 1976 that is just seen (M. Mahy, L. Van Eycken, A. Oosterlinck, Color Res. Appl. 19, 105, 1994)."""

# ICC.1:2022, 7.2.16: the white of the profile connection space, D50. Annex E.2: cone responses of XYZ by Bradford.
_D50 = np.array([0.9642, 1.0, 0.8249])
_BRADFORD = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])

_KNEE = 6 / 29
_AT_ONCE = 1 << 18


def light_of_code(code: Reals) -> Reals:
    """Linear light of sRGB code values of 0 to 1, any shape, in their own precision (IEC 61966-2-1)."""
    return _by_parts(lambda part: np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4), code)


def code_of_light(light: Reals) -> Reals:
    """sRGB code values of 0 to 1 of linear light, which is cut to 0 to 1, in its own precision (IEC 61966-2-1)."""

    def coded(part: Reals) -> Reals:
        shown = np.clip(part, 0.0, 1.0)
        return np.where(shown <= 0.0031308, 12.92 * shown, 1.055 * np.power(shown, 1 / 2.4) - 0.055)

    return _by_parts(coded, light)


def _by_parts(curve: Callable[[Reals], Reals], values: Reals) -> Reals:
    """A function of every value; a few at a time, so that a large picture takes little more than itself."""
    flat = values.ravel()
    curved = np.empty_like(flat)
    for start in range(0, flat.size, _AT_ONCE):
        part = slice(start, start + _AT_ONCE)
        curved[part] = curve(flat[part])
    return curved.reshape(values.shape)


def lab_of_linear_srgb(rgb: Floats) -> Floats:
    """CIE 1976 L*a*b* against the white of sRGB, [..., 3] from [..., 3] (CIE 15; ISO 11664-4). Greys have a* = b* = 0.

    Notes:
        The white is the sum of the matrix's own columns, so that rounding in the published matrix tints no grey.
    """
    relative = (rgb @ XYZ_OF_RGB.T) / XYZ_OF_RGB.sum(axis=1)
    root = np.where(relative > _KNEE**3, np.cbrt(relative), relative / (3 * _KNEE**2) + 4 / 29)
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def linear_srgb_of_lab_d50(lab: Floats) -> Floats:
    """Linear sRGB, also beyond 0 to 1, of CIE 1976 L*a*b* against D50, [..., 3]; whites are adapted by Bradford.

    As charts and profiles state colours (CIE 15; ICC.1:2022, annex E.2). Greys have three equal values.
    """
    level = (lab[..., 0] + 16) / 116
    root = np.stack([level + lab[..., 1] / 500, level, level - lab[..., 2] / 200], axis=-1)
    relative = np.where(root > _KNEE, root**3, (root - 4 / 29) * 3 * _KNEE**2)
    white = XYZ_OF_RGB.sum(axis=1)
    adapted = np.linalg.inv(_BRADFORD) @ np.diag((_BRADFORD @ white) / (_BRADFORD @ _D50)) @ _BRADFORD
    return np.asarray(relative * _D50 @ (np.linalg.inv(XYZ_OF_RGB) @ adapted).T)


def delta_e_1976(first: Floats, second: Floats) -> Floats:
    """Euclidean distance in L*a*b*, [...] from [..., 3] each (ISO 11664-4); see :data:`JUST_NOTICEABLE`."""
    return np.asarray(np.linalg.norm(first - second, axis=-1))


def luminance_centroid(emitters: Emitters, pitch_nm: int) -> tuple[float, float]:
    """Offset (x, y) of the light's centroid from the pixel's centre, in pixels; every colour sends its share of white.

    Colours weigh the same whatever their areas; those without area send nothing, and (0, 0) is the answer if all are.
    """
    labels = emitters.labels
    n = labels.shape[0]
    total, moment = 0.0, np.zeros(2)
    for colour, share in enumerate(LUMINANCE.tolist(), 1):
        rows, columns = (labels == colour).sum(axis=1), (labels == colour).sum(axis=0)
        area = rows.sum()
        if area:
            total += share
            moment += [share * (line @ np.arange(n) / area + 0.5 - n / 2) for line in (rows, columns)]
    if not total:
        return 0.0, 0.0
    y, x = moment / total * emitters.cell_nm / pitch_nm
    return float(x), float(y)
