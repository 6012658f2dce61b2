"""Maps filtered into cosine lobes, and shading by them.

It imports the other files of prefilter and the rooms below.
"""
