"""How images cover the sphere of directions, and the way from one to another."""
