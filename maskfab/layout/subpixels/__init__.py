"""Do red, green and blue emitters fit behind an opening, in every orientation, with the gaps that a maker keeps?"""
