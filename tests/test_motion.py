"""Motion presets: what is held, how a free decay is read, how the gust and the damping follow."""

import math

import numpy as np
import pytest

from phys4dgen.errors import SceneError
from phys4dgen.motion import choose_held, damped_frequency, damping_per_s, gust, gust_response_frequency
from phys4dgen.types import SOLID, Continuum, Frame, Parts, rotation_to_z_up

FRAME = Frame(rotation_to_z_up(np.array([0.0, -1, 0])), 0.5)


def _object(**boxes):
    """Particles that fill boxes (x0, x1, y0, y1, z0, z1 in metres, z up), one part each in the order given."""
    rng = np.random.default_rng(0)
    low = {name: np.array(box[::2], float) for name, box in boxes.items()}
    high = {name: np.array(box[1::2], float) for name, box in boxes.items()}
    points = np.concatenate([rng.uniform(low[name], high[name], (1500, 3)) for name in boxes])
    part = np.repeat(np.arange(len(boxes)), 1500).astype(np.int32)
    p = len(points)
    continuum = Continuum(
        positions=FRAME.from_metres(points),
        part=part,
        is_interior=np.zeros(p, bool),
        volume_m3=np.full(p, 1e-9),
        gaussian_index=np.full(p, -1, np.int32),
        piece=np.zeros(p, np.int32),
        shape=np.full(p, SOLID, np.int8),
        thickness_m=np.full(p, np.nan),
        thickness_measured=np.zeros(p, bool),
        offset_m=np.zeros((p, 3)),
        site=np.arange(p),
        spacing_m=2e-3,
    )
    return continuum, Parts(part, tuple(boxes), "test"), points


POT = (-0.05, 0.05, -0.05, 0.05, 0, 0.10)
SOIL = (-0.04, 0.04, -0.04, 0.04, 0.05, 0.095)
PLANT = (-0.10, 0.10, -0.10, 0.10, 0.09, 0.30)


def _held(objects, *, holds=None, automatic=True):
    continuum, parts, _ = objects
    return choose_held(continuum, parts, frame=FRAME, holds=holds or {}, automatic=automatic)


# ------------------------------------------------------------------------------------------------ what is held


def test_a_pot_is_held_with_the_soil_that_it_encloses():
    objects = _object(pot=POT, soil=SOIL, plant=PLANT)
    held = _held(objects)
    assert held.parts == ("pot", "soil")
    np.testing.assert_array_equal(held.particles, objects[0].part < 2)
    assert "pot, soil" in held.reason


def test_a_rim_just_over_the_pot_is_held_and_a_leaf_that_hangs_beside_it_is_not():
    objects = _object(
        leaf=(0.07, 0.12, -0.02, 0.02, 0.04, 0.095), pot=POT, rim=(-0.05, 0.05, -0.05, 0.05, 0.1, 0.104), plant=PLANT
    )
    assert _held(objects).parts == ("pot", "rim")


def test_a_saucer_is_held_with_the_pot_that_stands_in_it():
    objects = _object(
        saucer=(-0.08, 0.08, -0.08, 0.08, 0, 0.01), pot=(-0.05, 0.05, -0.05, 0.05, 0.01, 0.10), leaves=PLANT
    )
    assert _held(objects).parts == ("saucer", "pot")


def test_one_tall_part_is_held_by_its_lowest_tenth():
    objects = _object(tree=(-0.1, 0.1, -0.1, 0.1, 0, 0.5))
    held = _held(objects)
    assert held.parts == ()
    z = objects[2][:, 2]
    np.testing.assert_array_equal(held.particles, z < z[held.particles].max() + 1e-9)
    assert z[held.particles].max() == pytest.approx(0.05, abs=0.003)
    assert "lowest 10 %" in held.reason


def test_if_everything_stands_on_the_ground_only_the_lowest_tenth_is_held():
    """Two low parts side by side: nothing would move if both were held."""
    low = _object(
        left=(-0.3, -0.1, 0, 0.1, 0, 0.1), right=(0.1, 0.3, 0, 0.1, 0, 0.1), bush=(-0.05, 0.05, 0, 0.1, 0, 0.2)
    )
    assert _held(low).parts == ("left", "right")
    objects = _object(tall=(-0.3, -0.1, 0, 0.1, 0, 0.2), other=(0.1, 0.3, 0, 0.1, 0, 0.2))
    held = _held(objects)
    assert held.parts == ()
    assert 0.05 < held.particles.mean() < 0.15


def test_the_user_says_what_is_held():
    objects = _object(pot=POT, soil=SOIL, plant=PLANT)
    held = _held(objects, holds={"plant": "fixed"})
    assert held.parts == ("plant",)
    np.testing.assert_array_equal(held.particles, objects[0].part == 2)
    assert _held(objects, holds={"soil": "free"}).parts == ("pot",)
    loose = _held(objects, holds={"pot": "free", "soil": "free"})
    assert loose.parts == ()
    assert not loose.particles[objects[0].part < 2].any()


def test_without_a_preset_that_holds_nothing_is_held():
    objects = _object(pot=POT, soil=SOIL, plant=PLANT)
    held = _held(objects, automatic=False)
    assert not held.particles.any()
    assert held.reason == "nothing is held"
    assert _held(objects, holds={"pot": "fixed"}, automatic=False).parts == ("pot",)


def test_a_part_that_does_not_exist_is_named_with_the_right_one():
    with pytest.raises(SceneError, match=r"'pott'.*pot, plant.*pot") as caught:
        _held(_object(pot=POT, plant=PLANT), holds={"pott": "fixed"})
    assert "\n" not in str(caught.value)


# ------------------------------------------------------------------------------------------------ oscillation


@pytest.mark.parametrize("frequency_hz", [0.8, 2.0, 5.5])
@pytest.mark.parametrize("zeta", [0.0, 0.04, 0.08, 0.2])
def test_frequency_and_damping_are_read_from_a_free_decay(frequency_hz, zeta):
    t = np.arange(math.ceil(1.3 * 24)) / 24
    omega = 2 * math.pi * frequency_hz
    signal = 0.003 + 0.02 * np.exp(-zeta * omega * t) * np.cos(omega * math.sqrt(1 - zeta**2) * t + 0.7)
    found_hz, found_zeta = damped_frequency(signal, 1 / 24)
    assert found_hz == pytest.approx(frequency_hz, rel=0.05)
    assert found_zeta == pytest.approx(zeta, abs=0.02)


def test_the_reading_bears_noise_and_a_weaker_second_mode():
    rng = np.random.default_rng(1)
    t = np.arange(48) / 24
    signal = np.exp(-0.08 * 2 * math.pi * 1.7 * t) * np.sin(2 * math.pi * 1.7 * t)
    signal += 0.1 * np.exp(-0.08 * 2 * math.pi * 6.1 * t) * np.sin(2 * math.pi * 6.1 * t) + rng.normal(0, 0.02, 48)
    found_hz, found_zeta = damped_frequency(signal, 1 / 24)
    assert found_hz == pytest.approx(1.7, rel=0.05)
    assert found_zeta == pytest.approx(0.08, abs=0.02)


@pytest.mark.parametrize("frequency_hz", [0.8, 2.0, 5.5])
@pytest.mark.parametrize("zeta", [0.0, 0.08, 0.2])
@pytest.mark.parametrize("mean_m", [1e-5, 0.02])
def test_the_frequency_is_read_from_the_answer_to_a_gust(frequency_hz, zeta, mean_m):
    """Up to just after the first peak, as the probe runs; the oscillator is integrated in small steps."""
    omega, gust_s, fine_s = 2 * math.pi * frequency_hz, 0.3, 1e-4
    x, v, history = 0.0, 0.0, []
    for k in range(math.ceil((gust_s + 0.6 / frequency_hz) / fine_s)):
        load = mean_m * omega**2 if k * fine_s < gust_s else 0.0
        v += fine_s * (load - 2 * zeta * omega * v - omega**2 * x)
        x += fine_s * v
        history.append(x)
    every = round(1 / 48 / fine_s)
    signal = np.array(history)[every - 1 :: every]
    found_hz = gust_response_frequency(signal, every * fine_s, gust_s)
    assert found_hz == pytest.approx(frequency_hz, rel=0.10)


# ------------------------------------------------------------------------------------------------ gust


def test_a_gust_is_a_constant_acceleration_from_the_start():
    wind = gust(np.array([0.6, 0.0, 0.8]), 5.0, 0.3)
    assert wind.value_ms2 == pytest.approx((3.0, 0.0, 4.0))
    assert (wind.from_s, wind.to_s, wind.part) == (0.0, 0.3, None)
    np.testing.assert_allclose(wind.open_s(np.array([0.0, 0.1, 0.3, 1.0])), [0, 0.1, 0.3, 0.3])


def test_damping_makes_the_mode_decay_with_the_ratio_asked_for():
    """x'' + alpha x' + w^2 x = 0 decays as exp(-alpha t / 2), which is exp(-zeta w t)."""
    alpha = damping_per_s(0.08, 2.0)
    assert alpha == pytest.approx(4 * math.pi * 0.08 * 2.0)
    assert alpha / 2 == pytest.approx(0.08 * 2 * math.pi * 2.0)
