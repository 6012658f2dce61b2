"""The reference: converged images with a measured noise.

It imports shading and the rooms below. It does not use prefiltered light.
"""
