"""Packages that not every installation has, by the extra that installs them: ``pip install 'maskfab[solid]'``.

The core does without. What needs one of them refuses before any work, by :func:`require`, under one code.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import chain
from types import MappingProxyType

from maskfab.base.errors import MissingPackageError


@dataclass(frozen=True)
class Extra:
    """Packages that are installed together.

    Attributes:
        modules: by the names that they are imported by.
        use: of them, in words.
    """

    modules: tuple[str, ...]
    use: str

    @property
    def missing(self) -> tuple[str, ...]:
        """Modules that are not installed here; none is imported to find out."""
        return tuple(module for module in self.modules if not _is_installed(module))


EXTRAS: Mapping[str, Extra] = MappingProxyType(
    {
        "design": Extra(("torch",), "openings and maps designed, restorers that learn, gradients"),
        "solid": Extra(("cadquery", "trimesh", "manifold3d", "lxml", "networkx"), "STEP, GLB, 3MF and STL"),
        "gerber": Extra(("gerbonara",), "Gerber read back"),
        "raw": Extra(("rawpy",), "captures as RAW files"),
        "pandas": Extra(("pandas",), "tables for to_dataframe()"),
        "eye": Extra(("pycvvdp",), "ColorVideoVDP in maskfab check --look"),
        "cluster": Extra(("distributed",), "sweeps on a cluster"),
    }
)
"""Extras of ``pyproject.toml`` that a user may want, by name."""


def require(*extras: str, what: str, where: str = "", otherwise: str = "") -> None:
    """Refuse work that needs packages which are not installed.

    Args:
        extras: that install them.
        what: needs them, such as "writing stl".
        where: it was asked for.
        otherwise: what else could be done.

    Raises:
        MissingPackageError: MF152, with the command that installs them.
    """
    missing = {name: EXTRAS[name].missing for name in extras if EXTRAS[name].missing}
    if missing:
        needed = f"{what} needs {', '.join(chain(*missing.values()))}, not installed here"
        cure = f"Run pip install 'maskfab[{','.join(missing)}]'" + f", or {otherwise}" * bool(otherwise)
        raise MissingPackageError("MF152", needed, where=where, cure=cure)


def _is_installed(module: str) -> bool:
    if module in sys.modules:  # None there keeps it from being imported
        return sys.modules[module] is not None
    return find_spec(module) is not None
