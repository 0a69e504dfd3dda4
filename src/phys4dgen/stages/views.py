"""Views of the static object, for parts, for the inside and for people."""

from __future__ import annotations

from phys4dgen.progress import Progress
from phys4dgen.render.cameras import view_cameras
from phys4dgen.render.view_table import ViewPreset
from phys4dgen.render.views import render_views
from phys4dgen.scene import Scene
from phys4dgen.stages.asset import Asset
from phys4dgen.types import Views

__all__ = ["look", "rendered"]


def look(scene: Scene, asset: Asset, progress: Progress) -> Views:
    """Render the static object from the view table."""
    return rendered(asset, scene.views.preset, scene.views.size_px, progress)


def rendered(asset: Asset, preset: ViewPreset, size_px: int, progress: Progress) -> Views:
    """The object from one of the view tables (docs/conventions.md), square pictures of ``size_px``."""
    cameras = view_cameras(preset, lower=asset.lower, upper=asset.upper, rotation=asset.frame.rotation, size_px=size_px)
    return render_views(
        asset.gaussians, cameras, on_view=lambda k: progress.update(k + 1, len(cameras), "views rendered")
    )
