"""Lights: named options that become a cube map.

This is the highest room of envmap: it imports formats, projections and texels.
"""
