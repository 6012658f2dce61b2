"""Incoming radiance from all directions: cube maps, their pyramids, files and synthetic lights."""
