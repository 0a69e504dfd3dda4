"""The ground in a film: the soft shadow that an object throws on the plane below it.

Nothing shows better that an object falls, lands and rests. The shadow map is the object drawn from under the plane, so
that its lowest side hides the rest, with a darkness that fades with height: dense where it touches, faint where it
flies. The picture is composited over the plane, so the shadow never covers the object.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

from phys4dgen.render.rasterise import Rasteriser, RenderResult
from phys4dgen.types import Camera

__all__ = ["ShadowPlane"]

_MAP_PX = 224
_FAR = 12.0  # distance of the shadow camera in sides of the map: nearly parallel rays
_CONTACT_HEIGHT = 0.06  # of the map's side, over which a contact shadow fades
_CONTACT, _AMBIENT = 0.55, 0.16
_BLUR_PX, _WIDE_BLUR_PX = 2.0, 11.0


class ShadowPlane:
    """A horizontal plane and the shadow on it.

    Args:
        lower, upper: corners of the box that the object passes through, upright axes, input units, [3].
        height: of the plane along up, input units.
        rotation: input axes -> upright axes (z up), [3, 3].
    """

    def __init__(self, *, lower: ArrayLike, upper: ArrayLike, height: float, rotation: ArrayLike) -> None:
        low, high = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
        self._turn = np.asarray(rotation, np.float64)
        self._height = float(height)
        self._centre = 0.5 * (low + high)[:2]
        self._side = 1.6 * float((high - low)[:2].max())
        self._camera = self._from_below()
        self._rasteriser = Rasteriser()

    def darkness(self, means: ArrayLike, covariances: ArrayLike, opacities: ArrayLike) -> NDArray[np.float64]:
        """The shadow map of one frame, [rows along y, columns along x] of the plane, in [0, 1]."""
        points = np.asarray(means, np.float64) @ self._turn[2]
        near = np.exp(-np.maximum(points - self._height, 0) / (_CONTACT_HEIGHT * self._side))
        grey = np.repeat(near[:, None].astype(np.float32), 3, axis=1)
        seen = self._rasteriser.render(
            means, covariances, opacities, camera=self._camera, colors=grey, background=(0, 0, 0)
        )
        contact = gaussian_filter(seen.rgb[..., 0].astype(np.float64), _BLUR_PX)
        ambient = gaussian_filter(seen.alpha.astype(np.float64), _WIDE_BLUR_PX)
        return np.clip(_CONTACT * contact + _AMBIENT * ambient, 0, 1)

    def composite(
        self, picture: RenderResult, darkness: NDArray[np.float64], *, camera: Camera, background: ArrayLike
    ) -> NDArray[np.float32]:
        """The picture, drawn over ``background``, with the shadowed plane between the two, [H, W, 3]."""
        shade = self._shade(darkness, camera) * (1 - picture.alpha)
        return (picture.rgb - shade[..., None] * np.asarray(background, np.float32)).astype(np.float32)

    def _from_below(self) -> Camera:
        """A camera far under the plane, looking up; its picture has x to the right and y downwards."""
        upright = np.eye(4)  # x right, y down, z forward: already the upright axes seen from below
        upright[:3, 3] = [-self._centre[0], -self._centre[1], _FAR * self._side - self._height]
        turn = np.eye(4)
        turn[:3, :3] = self._turn
        focal = _FAR * _MAP_PX
        K = np.array([[focal, 0, _MAP_PX / 2], [0, focal, _MAP_PX / 2], [0, 0, 1]])
        return Camera(K=K, viewmat=upright @ turn, width=_MAP_PX, height=_MAP_PX)

    def _shade(self, darkness: NDArray[np.float64], camera: Camera) -> NDArray[np.float64]:
        """The darkness at each pixel's point of the plane, [H, W]; 0 where the pixel does not see the plane."""
        rotation = camera.viewmat[:3, :3] @ self._turn.T  # upright axes -> camera
        eye = -rotation.T @ camera.viewmat[:3, 3]
        columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        K = camera.K
        rays = np.stack([(columns - K[0, 2]) / K[0, 0], (rows - K[1, 2]) / K[1, 1], np.ones_like(columns)], -1)
        rays = rays @ rotation
        distance = np.divide(
            self._height - eye[2], rays[..., 2], out=np.full(columns.shape, -1.0), where=rays[..., 2] < -1e-9
        )
        hit = eye[:2] + distance[..., None] * rays[..., :2]
        place = (hit - self._centre) / self._side * _MAP_PX + _MAP_PX / 2 - 0.5
        found = map_coordinates(darkness, [place[..., 1], place[..., 0]], order=1, cval=0.0)
        return np.where(distance > 0, found, 0.0)
