"""The state of the process: numbers must not depend on it, and changes that a plug-in makes to it are undone.

It imports catalog and the loose files. It is low because the functions of the public interface settle the process
before they compute.
"""
