"""Image files of radiance: every format is read as an array of linear Rec. 709.

Its files import each other and the loose files, not the other rooms of envmap.
"""
