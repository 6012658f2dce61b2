"""The shade interface: methods and their stages, the cache of stages, costs, kernels."""
