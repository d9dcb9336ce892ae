"""A file for each family of formats: its writer, a reader that shares nothing with the writer, and its comparison.

Each lists its formats in ``FORMATS``; :mod:`maskfab.mask.formats.table` finds them there, so none of them imports it.
Modules that end in ``_process`` are run by path in a process of their own. Polygons come from
:mod:`maskfab.mask.figures`; houses and packages choose among formats above.
"""
