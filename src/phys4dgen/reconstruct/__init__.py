"""One picture -> static 3D Gaussians (paper: Sec. 3.1, Static 3D Gaussians Generation).

``foreground`` cuts the object out of the picture; a generator behind ``ImageTo3D`` makes the Gaussians. ``inflate`` is
the embedded stand-in that needs no weights.
"""
