"""A data matrix (ISO/IEC 16022), which a camera reads: what the plate was made from."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from maskfab.geometry.polygonize import outline
from maskfab.model import CLEAR, Furniture, Point


def code_text(signature: str, digest: str) -> str:
    """``maskfab:<version>:<job hash>`` of a plate whose signature starts with program and version."""
    return ":".join((*signature.split("|", 1)[0].split(), digest))


def modules(text: str) -> NDArray[np.bool_]:
    """The square symbol of a text with its quiet zone, bool [y, x], row 0 lowest, True where it is light."""
    import zxingcpp

    symbol = zxingcpp.create_barcode(text, zxingcpp.BarcodeFormat.DataMatrix, force_square=True)
    return np.array(symbol.to_image(scale=1, add_quiet_zones=True))[::-1] > 127


def data_matrix(name: str, centre_nm: Point, text: str, module_nm: int) -> Furniture:
    """The symbol in clear light modules; dark ones stay chrome.

    Args:
        name: of the mark.
        centre_nm: of the symbol.
        text: what it says.
        module_nm: side of a module.
    """
    light = modules(text)
    corner = centre_nm[0] - light.shape[1] * module_nm // 2, centre_nm[1] - light.shape[0] * module_nm // 2
    return Furniture(name, "code", CLEAR, outline(light, module_nm, corner))
