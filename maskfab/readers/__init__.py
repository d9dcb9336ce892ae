"""Mask files of any maker as layouts, by libraries that did not write them."""
