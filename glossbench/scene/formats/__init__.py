"""Mesh files: each format read as polygons."""
