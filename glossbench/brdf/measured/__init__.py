"""Measured BRDFs: one reader per file format, the table that it fills, and the density that samples tables.

It imports lobe.py, material.py and the models of brdf that are fitted to tables.
"""
