"""The process that everything runs in: what numbers may not depend on, and what a plug-in changes of it.

It imports catalog and the loose files. It is low because the functions of the public interface settle the process
before they compute.
"""
