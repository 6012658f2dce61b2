"""What every plug-in must keep, as checks that measure it.

It imports truth, shading and the rooms below.
"""
