"""Mesh files: each format is read as polygons.

Its files import each other and the loose files.
"""
