"""Maps filtered into cosine lobes, and shading with these maps.

It imports the other files of prefilter and the rooms below.
"""
