"""Reflectance models: one in each file, named as its paper names it.

It imports process, catalog and the loose files: a material looks at no light, and a light at no material.
"""
