"""Four views -> network -> Gaussians, and the same from one picture with a network that imagines the views."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from phys4dgen.errors import StageError
from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.reconstruct.lgm.activations import gaussians_from_raw
from phys4dgen.reconstruct.lgm.configuration import BIG, LgmConfiguration
from phys4dgen.reconstruct.lgm.four_views import FourViews, MultiViewGenerator
from phys4dgen.reconstruct.lgm.rays import pluecker_coordinates, view_cameras
from phys4dgen.reconstruct.reconstruction import Reconstruction

__all__ = ["Lgm", "network_input", "reconstruct_by_lgm", "torch_is_installed"]

IMAGENET_MEAN = np.array([0.485, 0.456, 0.406])
IMAGENET_DEVIATION = np.array([0.229, 0.224, 0.225])
"""Of the pictures that such networks were first trained on; every input is normalised by them."""


@cache
def torch_is_installed() -> bool:
    """Whether torch can be imported; does not import it."""
    return importlib.util.find_spec("torch") is not None


class Lgm:
    """A generator of the first stage from one picture: a network that imagines four views, and LGM.

    Args:
        checkpoint: the public safetensors file of LGM.
        multi_view: imagines the four views.
        config: sizes of the network; those of the public checkpoint by default.
    """

    def __init__(self, checkpoint: Path, multi_view: MultiViewGenerator, *, config: LgmConfiguration = BIG) -> None:
        self.checkpoint = checkpoint
        self.multi_view = multi_view
        self.config = config

    def __call__(self, cutout: Cutout) -> Reconstruction:
        """Make Gaussians of an object that was cut out of a picture; see ``reconstruct_by_lgm``."""
        made = reconstruct_by_lgm(self.multi_view(cutout), self.checkpoint, config=self.config)
        return replace(made, warnings=(*cutout.warnings, *made.warnings))


def reconstruct_by_lgm(views: FourViews, checkpoint: Path, *, config: LgmConfiguration = BIG) -> Reconstruction:
    """Make Gaussians of four views.

    They fill [-1, 1] at most; y is up and the object's front looks along +z.

    Args:
        views: of the object.
        checkpoint: the public safetensors file of LGM.
        config: sizes of the network; those of the public checkpoint by default.

    Raises:
        FormatError: the checkpoint cannot be used.
        StageError: torch is absent, or nothing comes out.
    """
    if not torch_is_installed():
        raise StageError("LGM needs torch, which is not installed; pip install 'phys4dgen[models]'.")
    import torch  # pyright: ignore[reportMissingImports]

    from phys4dgen.reconstruct.lgm.checkpoint import load_network

    device = "cuda" if torch.cuda.is_available() else "cpu"
    network = load_network(checkpoint, config, device=device)
    with torch.inference_mode():
        raw = network(torch.from_numpy(network_input(views, config.input_px)).to(device)).cpu().numpy()
    gaussians = gaussians_from_raw(raw)
    front = np.concatenate([views.rgb[0], views.alpha[0][..., None]], -1)
    is_cut_out = bool(front[..., 3].min() < 0.5)  # else what is object and what is white paper is not known
    return Reconstruction(
        gaussians,
        view_cameras(len(front))[0] if is_cut_out else None,
        front if is_cut_out else None,
        f"LGM, {views.source}",
        warnings=views.warnings,
        facts={"transparent_share": 1 - len(gaussians) / len(raw)},
    )


def network_input(views: FourViews, size_px: int) -> NDArray[np.float32]:
    """Normalised colours and the rays' Pluecker coordinates, shape [4, 9, size_px, size_px].

    Raises:
        ValueError: the views have another size.
    """
    if views.rgb.shape[1] != size_px:
        raise ValueError(f"views: expected {size_px} pixels, got {views.rgb.shape[1]}.")
    colors = (views.on_white() - IMAGENET_MEAN) / IMAGENET_DEVIATION
    rays = np.stack([pluecker_coordinates(camera) for camera in view_cameras(size_px)])
    return np.concatenate([np.moveaxis(colors, -1, 1), rays], 1).astype(np.float32)
