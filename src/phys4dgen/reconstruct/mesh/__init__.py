"""Meshes -> Gaussians: what many generators of 3D shapes give, and what modellers have (.glb, .obj, .ply, .stl).

The surface is sampled evenly by area; every sample becomes a flat disc in the surface with the colour of the texture or
of the vertices there. trimesh (extra ``mesh``) reads the files.
"""
