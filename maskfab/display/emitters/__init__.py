"""Placement of red, green and blue emitters in the opaque area around an opening, for every orientation."""
