"""Fixtures that every test may use."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from phys4dgen.types import Gaussians

SHARED_DATA = (Path(__file__).parents[1] / "../shared/data").resolve()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The how-tos first: with several workers the longest file must not begin last."""
    items.sort(key=lambda item: item.path.name != "test_howtos.py")


def pytest_configure() -> None:
    """A shell starts what runs in its background deaf to Ctrl-C, and children inherit that; some tests send it."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of real captures and meshes made by others; the test is skipped where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the folder of real test data (../shared/data) is not here")
    return SHARED_DATA


@pytest.fixture(scope="session")
def random_gaussians() -> Callable[..., Gaussians]:
    """Factory of Gaussians with every value in its usual range: ``random_gaussians(n, sh_degree=0, seed=0)``."""

    def make(n: int, *, sh_degree: int = 0, seed: int = 0) -> Gaussians:
        rng = np.random.default_rng(seed)
        quats = rng.normal(size=(n, 4))
        return Gaussians(
            means=rng.normal(size=(n, 3)).astype(np.float32),
            quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
            scales=np.exp(rng.normal(-4, 1, size=(n, 3))).astype(np.float32),
            opacities=rng.uniform(0.01, 0.99, size=n).astype(np.float32),
            sh=rng.normal(0, 0.5, size=(n, (sh_degree + 1) ** 2, 3)).astype(np.float32),
        )

    return make
