"""Writers of a plate's files, one module for each format. Reading them back is in :mod:`maskfab.readers`."""
