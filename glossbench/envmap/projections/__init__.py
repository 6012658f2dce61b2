"""How images cover the sphere of directions, and the way from one to another.

It imports cubemap.py and the loose files.
"""
