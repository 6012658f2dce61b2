"""The catalogue of public inputs: names, addresses, hashes and licences; no code."""
