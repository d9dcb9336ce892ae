"""Rules that an opening must keep to be made and wired, and families of shapes that keep them."""
