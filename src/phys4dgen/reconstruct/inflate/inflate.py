"""Picture -> outline -> body -> surface -> Gaussians: the steps of the stand-in in order."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy.ndimage as nd
from numpy.typing import NDArray

from phys4dgen.reconstruct.foreground import Cutout
from phys4dgen.reconstruct.framing import CAMERA_DISTANCE, FILL, HALF_HEIGHT, canonical_camera, framed, longest_side
from phys4dgen.reconstruct.inflate.even_light import evenly_lit
from phys4dgen.reconstruct.inflate.gaussians import oriented_gaussians
from phys4dgen.reconstruct.inflate.paint import painted
from phys4dgen.reconstruct.inflate.perspective import InflatedSolid, Perspective
from phys4dgen.reconstruct.inflate.refine import refined_colors
from phys4dgen.reconstruct.inflate.segments import color_segments
from phys4dgen.reconstruct.inflate.silhouette import Silhouette, silhouette
from phys4dgen.reconstruct.inflate.surface import Kind, surface_points, walls
from phys4dgen.reconstruct.inflate.thickness import Thickness, relief, thickness
from phys4dgen.reconstruct.mask_geometry import depth_inside, nearest_inside, shrunk
from phys4dgen.reconstruct.reconstruction import Reconstruction
from phys4dgen.types import SH_C0, Gaussians

__all__ = ["InflateOptions", "inflate"]

_LEAST_SIDE_PX, _LARGEST_SIDE_PX = 96, 512
_WARNING = (
    "The object was inflated from its outline (stand-in for an image-to-3D network): depth and back are guesses; flat, "
    "tilted or hollow things, several objects, and pictures from above come out wrong."
)


@dataclass(frozen=True)
class InflateOptions:
    """Choices of the stand-in.

    Attributes:
        front_gaussians: about this many Gaussians face the camera; all together are some three times as many.
        thickness: depth relative to what the outline says.
    """

    front_gaussians: int = 40_000
    thickness: float = 1.0


def inflate(cutout: Cutout, options: InflateOptions = InflateOptions()) -> Reconstruction:
    """Inflate an object that was cut out of a picture.

    Args:
        cutout: the object.
        options: see ``InflateOptions``.
    """
    picture = framed(cutout.rgba, _working_side(cutout.rgba, options.front_gaussians))
    size = len(picture)
    outline = silhouette(picture[..., 3])
    front_rgb = _without_fringe(picture[..., :3], outline.mask)
    body = thickness(outline, front_rgb, gain=options.thickness)
    segments = color_segments(front_rgb, outline.mask)
    relief_front, relief_back = relief(segments, outline.mask)
    fade = np.clip(body.height / (0.06 * size), 0, 1)
    both = walls(
        outline,
        np.maximum(body.height + relief_front * fade, 0),
        np.maximum(body.height + relief_back * fade, 0),
        radius=body.balls.radius,
    )
    points = surface_points(both, outline.mask)
    perspective = Perspective(_bend(body, outline), _horizon_row(outline), outline.tilt)
    colors = painted(points, front_rgb, outline=outline, body=body)
    even_rgb = evenly_lit(front_rgb, outline.mask, height=body.height, segments=segments)
    even_colors = painted(points, even_rgb, outline=outline, body=body)
    gaussians, normals = oriented_gaussians(points, perspective)
    camera = canonical_camera(size, horizon=perspective.horizon, upright=perspective.upright)
    to_camera = camera.position - gaussians.means
    facing = (normals * to_camera).sum(1) / np.linalg.norm(to_camera, axis=1)
    colors = refined_colors(
        gaussians,
        colors,
        picture=picture,
        camera=camera,
        position=points.position,
        facing=np.where(points.kind <= Kind.STEEP, facing, 0),
    )
    sh = ((colors - 0.5) / SH_C0)[:, None].astype(np.float32)
    gaussians = Gaussians(gaussians.means, gaussians.quats_wxyz, gaussians.scales, gaussians.opacities, sh)
    return Reconstruction(
        gaussians,
        camera,
        picture,
        "inflate (stand-in)",
        solid=InflatedSolid.of(both, perspective),
        even_colors=even_colors.astype(np.float32),
        warnings=(*cutout.warnings, _WARNING),
        facts={
            "working_side_px": float(size),
            "revolve_share": float(body.revolve[outline.mask.any(1)].mean()),
            "camera_elevation_deg": math.degrees(math.atan(perspective.lean)),
        },
    )


def _working_side(rgba: NDArray[np.float32], front_gaussians: int) -> int:
    """Side of the working grid: fine enough for the Gaussians wanted, not finer than the picture."""
    probe = framed(rgba, 2 * _LEAST_SIDE_PX)
    share = float((probe[..., 3] > 0.5).mean())
    wanted = math.sqrt(front_gaussians / max(share, 1e-3))
    native = 1.25 * longest_side(rgba[..., 3]) / FILL
    return int(np.clip(min(wanted, native), _LEAST_SIDE_PX, _LARGEST_SIDE_PX))


def _without_fringe(rgb: NDArray[np.float32], mask: NDArray[np.bool_]) -> NDArray[np.float32]:
    """The outermost pixels, mixed with the background, take the colour of the nearest pixel further in."""
    reach = max(1, round(len(mask) / 200))
    depth = depth_inside(mask)
    # Thin parts keep their middle line.
    ridge = mask & (depth >= nd.maximum_filter(depth, 2 * reach + 1) - 0.5) & (depth > 1)
    return rgb[nearest_inside(shrunk(mask, reach) | ridge)]


def _bend(body: Thickness, outline: Silhouette) -> NDArray[np.float64]:
    """How far the middle surface is moved forward, world units."""
    size = len(outline.mask)
    smooth = np.asarray(nd.gaussian_filter(body.offset[nearest_inside(outline.mask)], size / 60))
    return smooth * (2 * HALF_HEIGHT / size) ** 2 / CAMERA_DISTANCE


def _horizon_row(outline: Silhouette) -> float:
    """At the base, so that it stays flat; in the middle of the picture where there is none."""
    return len(outline.mask) / 2 - 0.5 if outline.base_row is None else float(outline.base_row)
