"""Ground of every room: vocabulary, units, errors, quantities, processes, and files written whole or not at all.

No format of a mask and no key of a job is known here, and no other room is imported.
"""

__version__ = "0.2.0"
