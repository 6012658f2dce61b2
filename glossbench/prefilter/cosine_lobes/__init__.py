"""Maps filtered into cosine lobes, and shading by them."""
