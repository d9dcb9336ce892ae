"""Scenes: the effects that matter in one, the cheapest model within its accuracy, and its PSFs."""
