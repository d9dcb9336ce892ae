"""The expected error of restored photographs behind an opening or a panel, without photographing anything."""
