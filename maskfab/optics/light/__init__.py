"""Colours of light: camera responses, illuminants, and the wavelengths that stand for a band."""
