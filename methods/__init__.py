"""The shading methods: each is one file, or a folder if it needs several. The registry finds them in this package.

A method imports `glossbench.prefilter` and libraries, never another method; files of a folder import each other.
"""
