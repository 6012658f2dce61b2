"""Reflectance models, one per file, with the name that its paper uses.

It imports process, catalog and the loose files: materials and lights do not know each other.
"""
