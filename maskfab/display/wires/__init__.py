"""Wiring of the pixels: lines through the closed area, lines in the gutter, ports that fit in every orientation."""
