"""Written files against the plate that they were written from.

Finished folders are checked again in :mod:`maskfab.verification`.
"""
