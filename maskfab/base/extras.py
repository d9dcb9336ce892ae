"""Packages that not every installation has, by the extra that installs them, and libraries of the system.

The core does without. What needs one of them refuses before any work, by :func:`require`, under one code.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from types import MappingProxyType
from typing import Any

from maskfab.base.errors import MissingPackageError


@dataclass(frozen=True)
class Extra:
    """Packages that are installed together, with the modules that they are imported by and, in words, their use."""

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

_DEBIAN = {
    "libGL.so.1": "libgl1", "libEGL.so.1": "libegl1", "libX11.so.6": "libx11-6", "libXext.so.6": "libxext6",
    "libXrender.so.1": "libxrender1", "libSM.so.6": "libsm6", "libICE.so.6": "libice6", "libxcb.so.1": "libxcb1",
    "libgomp.so.1": "libgomp1", "libfontconfig.so.1": "libfontconfig1", "libfreetype.so.6": "libfreetype6",
    "libexpat.so.1": "libexpat1", "libstdc++.so.6": "libstdc++6", "libz.so.1": "zlib1g",
}  # fmt: skip
"""Packages of Debian and Ubuntu by the library that they hold; wheels bring all others."""


def require(*extras: str, what: str, where: str = "", otherwise: str = "", loads: Sequence[str] = ()) -> None:
    """Refuse work that needs packages which are not installed, or libraries that the system lacks.

    Args:
        extras: that install them.
        what: needs them, such as "writing stl".
        loads: compiled modules of theirs that load libraries of the system.

    Raises:
        MissingPackageError: MF152, with the command that installs them.
    """
    missing = {name: EXTRAS[name].missing for name in extras if EXTRAS[name].missing}
    lacking = lacking_libraries(*loads)
    if not missing and not lacking:
        return
    needed = f"{what} needs {', '.join([*chain(*missing.values()), *lacking])}, not installed here"
    cures = [install_command(*missing)] if missing else []
    if lacking:
        packages = " ".join(dict.fromkeys(_DEBIAN[name] for name in lacking))
        cures.append(f"run apt-get install {packages} (Debian, Ubuntu; elsewhere what holds {', '.join(lacking)})")
    cure = " and ".join(cures) + f", or {otherwise}" * bool(otherwise)
    raise MissingPackageError("MF152", needed, where=where, cure=cure[:1].upper() + cure[1:])


@cache
def lacking_libraries(*modules: str) -> tuple[str, ...]:
    """Libraries that compiled modules need and this system lacks, as its own loader tells; none is loaded."""
    import shutil
    import subprocess

    loader = shutil.which("ldd") if sys.platform == "linux" else None
    files: list[Path] = []
    for spec in filter(None, (find_spec(module) if _is_installed(module) else None for module in modules)):
        folders = map(Path, spec.submodule_search_locations or ())
        files += chain(*(folder.glob("*.so") for folder in folders), [Path(spec.origin or "")])
    told = "".join(
        subprocess.run([loader, file], capture_output=True, text=True, check=False).stdout
        for file in files
        if loader is not None and file.suffix == ".so"
    )
    lines = (line.partition(" => ") for line in told.splitlines())
    found = (name.strip() for name, _, at in lines if at == "not found")
    return tuple(dict.fromkeys(name for name in found if name in _DEBIAN))


def install_command(*extras: str) -> str:
    """The way to install extras, as this installation itself was made: from a checkout, a wheel or a repository."""
    import json
    import shlex
    from importlib import metadata
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    told: dict[str, Any] = {}
    with suppress(metadata.PackageNotFoundError, ValueError):
        told = json.loads(metadata.distribution("maskfab").read_text("direct_url.json") or "{}")
    url, named = told.get("url", ""), f"[{','.join(extras)}]" * bool(extras)
    if "vcs_info" in told:
        source = "{vcs}+{url}@{commit_id}".format(url=url, **told["vcs_info"])
        return f"run pip install {shlex.quote(f'maskfab{named} @ {source}')}"
    path = Path(url2pathname(urlsplit(url).path)) if url.startswith("file:") else None
    if path is None or not path.exists():
        return f"run pip install 'PATH{named}', PATH being the checkout or the wheel that maskfab was installed from"
    editable = "--editable " * bool(told.get("dir_info", {}).get("editable"))
    return f"run pip install {editable}{shlex.quote(f'{path}{named}')}"


def _is_installed(module: str) -> bool:
    if module in sys.modules:  # None there keeps it from being imported
        return sys.modules[module] is not None
    return find_spec(module) is not None
