"""Measured BRDFs: a reader for each file format, the table that it fills, and the density by which tables are sampled.

It imports lobe.py, material.py and models of brdf that are fitted to tables.
"""
