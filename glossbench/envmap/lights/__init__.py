"""Lights: named options that become a cube map."""
