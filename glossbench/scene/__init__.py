"""The surfaces to shade: views, and the shading points that they see.

It imports envmap, process, catalog and the loose files.
"""
