"""Polynomials, their transforms and quadrature, in the forms that the optics needs and scipy does not have."""
