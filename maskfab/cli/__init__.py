"""The command line: commands derived from the functions of :mod:`maskfab.api`.

Results go to stdout, progress and errors to stderr. A command imports what it needs when it is called.
"""

from maskfab.cli.program import run_command_line

__all__ = ["run_command_line"]
