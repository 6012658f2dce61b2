"""Measured BRDFs: a reader a file format, the table that it fills, and the density by which tables are sampled."""
