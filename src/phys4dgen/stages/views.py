"""Views of the static object, for parts, for the inside and for people.

Paper: Sec. 3.4 takes the user's picture as the canonical view. Where an object was made from a picture, the first view
is that picture's own camera.
"""

from __future__ import annotations

import numpy as np

from phys4dgen.progress import Progress
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.view_table import ViewPreset
from phys4dgen.render.views import render_views
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Camera, Views

__all__ = ["look", "rendered"]


def look(scene: Scene, asset: Asset, progress: Progress) -> Views:
    """Render the static object from the view table; the first view of one made from a picture is the picture's own."""
    size_px = scene.views.size_px
    cameras = _table(asset, scene.views.preset, size_px)
    if asset.camera is not None:
        cameras = _with_canonical_first(cameras, asset.camera.resized(size_px, size_px))
    return _rendered(asset, cameras, progress)


def rendered(asset: Asset, preset: ViewPreset, size_px: int, progress: Progress) -> Views:
    """The object from one of the view tables (docs/conventions.md), square pictures of ``size_px``."""
    return _rendered(asset, _table(asset, preset, size_px), progress)


def _table(asset: Asset, preset: ViewPreset, size_px: int) -> tuple[Camera, ...]:
    return view_cameras(preset, lower=asset.lower, upper=asset.upper, rotation=asset.frame.rotation, size_px=size_px)


def _with_canonical_first(cameras: tuple[Camera, ...], canonical: Camera) -> tuple[Camera, ...]:
    """The canonical camera in the place of the one that looks most like it, and before all others."""
    alike = [float(camera.viewmat[2, :3] @ canonical.viewmat[2, :3]) for camera in cameras]
    nearest = int(np.argmax(alike))
    return (canonical, *cameras[:nearest], *cameras[nearest + 1 :])


def _rendered(asset: Asset, cameras: tuple[Camera, ...], progress: Progress) -> Views:
    return render_views(
        asset.gaussians, cameras, on_view=lambda k: progress.update(k + 1, len(cameras), "views rendered")
    )
