"""The clear shape of one pixel: drawn from numbers, read from files, taken from displays.

How cells are tiled is in :mod:`maskfab.mask`.

Panels of tiled cells and the plate that holds them. Polygons are drawn in :mod:`maskfab.mask`.

Everything on a plate but its dies: titles, fiducials, test patterns, and templates that place them.

Masks as polygons and rasters, exact to the nanometre.

Files are read in :mod:`maskfab.mask`, rules checked in :mod:`maskfab.mask.plate_rules`.

Writers of a plate's files, one module for each format. Reading them back is in :mod:`maskfab.mask`.

Mask files of any maker as layouts, by libraries that did not write them.

Written files against the plate that they were written from.

Finished folders are checked again in :mod:`maskfab.runs.verification`.

Foreign files are read and worked on in processes with limits of time and memory.
"""
