"""Lights: named options that become a cube map.

The top of envmap: it imports its formats, projections and texels.
"""
