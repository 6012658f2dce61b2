"""The contract that every method must keep, as checks that measure it.

The room imports truth, shading and the rooms below.
"""
