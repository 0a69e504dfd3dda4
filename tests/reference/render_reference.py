"""Slow float64 renderer of 3D Gaussians with gsplat's rules, written from the rules and not from the kernels.

One Gaussian after the other, front to back, over all pixels of the picture; no tiles, no bounding boxes, no
approximation of exp. Unlike the kernels it follows gsplat also in dropping the Gaussian that would carry a pixel's
transmittance to 1e-4 or below.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import lpmv


@dataclass
class ReferencePicture:
    rgb: np.ndarray  # [H, W, 3]
    alpha: np.ndarray  # [H, W]
    expected_depth: np.ndarray  # [H, W]
    median_depth: np.ndarray  # [H, W], 0 where there is none
    median_index: np.ndarray  # [H, W], -1 where there is none


def real_spherical_harmonics(degree, directions):
    """[N, (degree + 1)^2]; sqrt(2) times real and imaginary part of Y_l^m with the Condon-Shortley phase."""
    x, y, z = directions.T
    azimuth = np.arctan2(y, x)
    columns = []
    for band in range(degree + 1):
        for order in range(-band, band + 1):
            m = abs(order)
            norm = math.sqrt((2 * band + 1) / (4 * math.pi) * math.factorial(band - m) / math.factorial(band + m))
            polar = norm * lpmv(m, band, z)
            if order == 0:
                columns.append(polar)
            else:
                turning = np.cos(m * azimuth) if order > 0 else np.sin(m * azimuth)
                columns.append(math.sqrt(2) * polar * turning)
    return np.stack(columns, axis=1)


def project(means, covariances, opacities, viewmat, K, width, height, *, antialiased=False):
    """Screen-space means [N, 2], inverse covariances [N, 2, 2], opacities [N] and depths [N]."""
    rotation, translation = viewmat[:3, :3], viewmat[:3, 3]
    points = means @ rotation.T + translation
    depth = points[:, 2]
    focal = np.array([K[0, 0], K[1, 1]])
    principal = np.array([K[0, 2], K[1, 2]])
    size = np.array([width, height])
    tangent = points[:, :2] / depth[:, None]
    margin = 0.3 * (0.5 * size / focal)
    clamped = np.clip(tangent, -principal / focal - margin, (size - principal) / focal + margin)
    jacobian = np.zeros((len(means), 2, 3))
    for axis in range(2):
        jacobian[:, axis, axis] = focal[axis] / depth
        jacobian[:, axis, 2] = -focal[axis] * clamped[:, axis] / depth
    to_screen = jacobian @ rotation
    sharp = to_screen @ covariances @ to_screen.transpose(0, 2, 1)
    blurred = sharp + 0.3 * np.eye(2)
    if antialiased:
        opacities = opacities * np.sqrt(np.maximum(np.linalg.det(sharp) / np.linalg.det(blurred), 0))
    return tangent * focal + principal, np.linalg.inv(blurred), opacities, depth


def render(means, covariances, opacities, *, camera, sh=None, colors=None, background=(1, 1, 1), antialiased=False,
           near=0.01):  # fmt: skip
    means, covariances, opacities = (np.asarray(a, np.float64) for a in (means, covariances, opacities))
    width, height = camera.width, camera.height
    if colors is None:
        coefficients = np.asarray(sh, np.float64)
        eye = np.linalg.inv(camera.viewmat)[:3, 3]
        directions = means - eye
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        basis = real_spherical_harmonics(math.isqrt(coefficients.shape[1]) - 1, directions)
        colors = np.maximum(0.5 + np.einsum("nk,nkc->nc", basis, coefficients), 0)
    index = np.flatnonzero((means @ camera.viewmat[2, :3] + camera.viewmat[2, 3]) > near)
    centres, conics, alphas, depths = project(
        means[index], covariances[index], opacities[index], camera.viewmat, camera.K, width, height,
        antialiased=antialiased,
    )  # fmt: skip
    pixel_x, pixel_y = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5

    transmittance = np.ones((height, width))
    active = np.ones((height, width), bool)
    rgb = np.zeros((height, width, 3))
    depth_sum = np.zeros((height, width))
    median_depth = np.zeros((height, width))
    median_index = np.full((height, width), -1)
    for i in np.argsort(depths, kind="stable"):
        dx, dy = pixel_x - centres[i, 0], pixel_y - centres[i, 1]
        (xx, xy), (_, yy) = conics[i]
        exponent = 0.5 * (xx * dx * dx + yy * dy * dy) + xy * dx * dy
        alpha = np.minimum(0.999, alphas[i] * np.exp(-exponent))
        drawn = active & (alpha >= 1 / 255)
        after = transmittance * (1 - alpha)
        active &= ~(drawn & (after <= 1e-4))
        drawn &= active
        weight = np.where(drawn, transmittance * alpha, 0)
        for channel in range(3):
            rgb[..., channel] += weight * colors[index[i]][channel]
        depth_sum += weight * depths[i]
        crossing = drawn & (transmittance > 0.5) & (after <= 0.5)
        median_depth[crossing] = depths[i]
        median_index[crossing] = index[i]
        transmittance = np.where(drawn, after, transmittance)
    alpha = 1 - transmittance
    return ReferencePicture(
        rgb=rgb + transmittance[..., None] * np.asarray(background, np.float64),
        alpha=alpha,
        expected_depth=np.divide(depth_sum, alpha, out=np.zeros_like(alpha), where=alpha > 0),
        median_depth=median_depth,
        median_index=median_index,
    )


def psnr_db(picture, reference):
    """Peak signal-to-noise ratio of two pictures clipped to [0, 1]."""
    error = np.clip(picture, 0, 1).astype(np.float64) - np.clip(reference, 0, 1)
    return -10 * math.log10(max(float(np.mean(error**2)), 1e-30))
