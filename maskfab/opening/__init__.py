"""The clear shape of one pixel: drawn from numbers, read from files, taken from displays.

How cells are tiled is in :mod:`maskfab.plate`.
"""
