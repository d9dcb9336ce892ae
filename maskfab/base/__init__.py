"""Ground of every room: vocabulary, units, errors, quantities, files written whole, processes.

Files and folders that appear whole or not at all, and what a finished folder is known to hold.

No format is known here.
"""

__version__ = "0.1.0"
