"""The eye: how a display looks whose pixels make room for a camera."""
