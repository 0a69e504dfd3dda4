"""phys4dgen: one image or one 3D Gaussian splat in, 4D content that obeys physics out."""
