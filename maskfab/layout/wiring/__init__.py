"""Can the pixels be wired: lines under the closed area, lines in the gutter, ports that fit in every orientation?"""
