"""Diffraction by a panel before a lens. Everything here is physics on arrays; files and reports are elsewhere.

Polynomials, their transforms and quadrature, in the forms that the optics needs and scipy does not have.

The part of the panel that the lens sees: apertures, stops of any shape, wires.

From a pupil to PSF, OTF and MTF.

Colours of light: camera responses, illuminants, and the wavelengths that stand for a band.

Numbers taken from a PSF or MTF, each with unit, method and error.

Phase and parallax: defocus, aberrations, and a panel at some distance from the stop.

Speed and error of the optics, beside other libraries and on hard cases.

Nothing here is used to make or judge a plate.
"""
