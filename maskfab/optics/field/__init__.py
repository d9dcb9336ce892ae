"""The complex far field of a pupil, by methods that check each other."""
