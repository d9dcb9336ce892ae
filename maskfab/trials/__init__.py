"""Speed and error of the optics, beside other libraries and on hard cases with known answers; nothing is made by it."""
