"""Gradient descent on relaxed dots: losses, schedules and the stop they are computed on."""
