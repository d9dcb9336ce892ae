"""The expected error of photographs behind an opening or a panel, without taking any, and proven limits of it."""
