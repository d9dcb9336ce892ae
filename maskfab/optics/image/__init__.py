"""From a pupil to PSF, OTF and MTF."""
