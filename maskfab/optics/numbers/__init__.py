"""Numbers taken from a PSF or MTF, each with unit, method and error."""
