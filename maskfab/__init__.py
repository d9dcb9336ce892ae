"""maskfab: photomask plates for under-panel cameras, and the pictures they will make.

    >>> import maskfab
    >>> job = maskfab.load_job("layouts/upc12.toml")        # doctest: +SKIP
    >>> result = maskfab.run(job, "build/upc12")            # doctest: +SKIP

The types are in :mod:`maskfab.model`; the chain is on one page in :mod:`maskfab.pipeline`.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from maskfab.job import load as load_job
    from maskfab.measure.analysis import analyse as analyse
    from maskfab.pipeline import run as run
    from maskfab.verification import verify as verify

__version__ = "0.1.0"
__all__ = ["__version__", "analyse", "load_job", "run", "verify"]

_WHERE = {
    "analyse": ("maskfab.measure.analysis", "analyse"),
    "load_job": ("maskfab.job", "load"),
    "run": ("maskfab.pipeline", "run"),
    "verify": ("maskfab.verification", "verify"),
}


def __getattr__(name: str) -> Any:
    """Import the heavy rooms only when one of their functions is asked for."""
    if name not in _WHERE:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module, attribute = _WHERE[name]
    return getattr(import_module(module), attribute)
