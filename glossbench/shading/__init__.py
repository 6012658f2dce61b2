"""The shade interface: methods and their stages, the cache of stages, costs, kernels.

It imports scene, brdf, envmap and the rooms below, and no method: methods are found by their registry. The room is not
called shade, for `glossbench.shade` is the public function.
"""
