"""The shade interface: methods and their stages, the cache of stages, costs, kernels.

It imports scene, brdf, envmap and the rooms below, but not the methods: their registry finds them. The room is not
called shade, because `glossbench.shade` is the public function.
"""
