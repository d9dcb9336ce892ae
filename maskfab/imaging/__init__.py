"""What the eye sees of a display whose pixels make room for a camera."""
