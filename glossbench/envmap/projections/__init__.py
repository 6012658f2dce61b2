"""How images cover the sphere of directions, and the conversion between them and cube maps.

It imports cubemap.py and the loose files.
"""
