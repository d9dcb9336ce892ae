"""The command line: one file for each verb.

Results go to stdout, progress and errors to stderr. Every verb imports what it needs when it is called.
"""

from maskfab.cli.app import run_command_line
from maskfab.cli.verbs.shape import SHAPES as _SHAPES

__all__ = ["_SHAPES", "run_command_line"]
