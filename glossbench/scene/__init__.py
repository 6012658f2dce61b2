"""What is shaded: views and the shading points that they see."""
