"""Image files of radiance: each format read as an array of linear Rec. 709."""
