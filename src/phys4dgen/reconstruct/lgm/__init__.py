"""LGM: four views of an object -> 3D Gaussians, by an asymmetric U-Net (the paper's first stage, Sec. 3.1).

Tang et al., "LGM: Large Multi-View Gaussian Model for High-Resolution 3D Content Creation", ECCV 2024. Our own
implementation after the published architecture; it loads the public checkpoint ``model_fp16_fixrot.safetensors``
(docs/lgm.md). Importing this package does not import torch; ``network`` and what it is made of do.
"""
