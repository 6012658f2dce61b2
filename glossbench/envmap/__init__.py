"""Incoming radiance from all directions: cube maps, their pyramids, files and synthetic lights.

It imports catalog and the loose files only.
"""
