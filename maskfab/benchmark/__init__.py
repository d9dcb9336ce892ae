"""Speed and error of the optics, beside other libraries and on hard cases.

Nothing here is used to make or judge a plate.
"""
