"""Diffraction by a panel before a lens, as physics on arrays; files and reports are elsewhere.

From the part of the panel that the lens sees (apertures, stops of any shape, wires) to the pupil, its far field, PSF,
OTF and MTF; colours of light, and the wavelengths that stand for a band; defocus, aberrations, and a panel at some
distance from the stop; scenes; numbers taken from a PSF or MTF, each with unit, method and error; and the speed and
error of the optics beside other libraries and on hard cases. Nothing here is used to make or judge a plate.
"""
