"""Entry point. Answers ``--version`` before anything else is imported."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; the exit code is 0, 1, 2 or 3 as ``maskfab --help`` says."""
    if sys.argv[1:] == ["--version"]:
        from maskfab.base import __version__

        print(f"maskfab {__version__}")
        return
    from maskfab.base.work import settle
    from maskfab.cli.program import run_command_line

    settle()
    sys.exit(run_command_line(sys.argv[1:]))


if __name__ == "__main__":
    main()
