"""The reference: converged images with a measured noise."""
