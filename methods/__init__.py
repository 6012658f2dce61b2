"""The plug-ins that shade: each is one file, or a folder where it needs several, found by its presence here.

A method imports `glossbench.prefilter` and libraries, never another method; files of a folder import each other.
"""
