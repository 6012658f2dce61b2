"""The reference: converged images with a measured noise.

It imports shading and the rooms below. It looks at nothing that is prefiltered.
"""
