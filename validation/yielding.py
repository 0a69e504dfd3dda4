"""Laws that flow, at material points driven through the engine's own functions (B10, B11, B20, B20b)."""

from __future__ import annotations

import numpy as np

from phys4dgen.mpm import LawId
from validation.case import Check, Outcome, benchmark
from validation.chart import Chart, Curve
from validation.points import Points, deviator

__all__ = ["bingham", "crushed_snow", "pulled_metal", "triaxial_sand"]

_ISOCHORIC = np.diag([1.0, -0.5, -0.5])


@benchmark(
    "B10",
    "Metal pulled until it yields (von Mises)",
    source="Uniaxial yield: q = sY at a strain of sY / 3 mu; then q = sY + H a",
    variants={"perfectly plastic": {"hardening_pa": 0.0}, "hardening": {"hardening_pa": 5e4}},
    in_tests=("perfectly plastic", "hardening"),
)
def pulled_metal(*, hardening_pa: float) -> Outcome:
    """A point (E 1e6 Pa, nu 0.3, sY 1e4 Pa) is stretched at constant volume, 1e-5 a step, to three times its yield."""
    yield_pa, mu, step = 1e4, 1e6 / 2.6, 1e-5
    points = Points(LawId.VON_MISES, E=1e6, yield_stress_pa=yield_pa, hardening_modulus_pa=hardening_pa)
    strain = step * np.arange(1, 2601)
    q = np.array([np.sqrt(1.5) * deviator(points.step(_ISOCHORIC, dt=step))[1][0] for _ in strain])
    flow = np.sqrt(2 / 3) * points.state["flow"][0]
    yielded = strain[q >= 0.9999 * yield_pa][0]
    return Outcome(
        (
            Check.share(
                "von Mises stress at the end, Pa", q[-1], expected=yield_pa + hardening_pa * flow, tolerance=1e-4
            ),
            Check.near("strain at yield", yielded, expected=yield_pa / (3 * mu), tolerance=2 * step),
            Check.near("elastic volume ratio", np.linalg.det(points.elastic_b)[0], expected=1.0, tolerance=1e-4),
        ),
        (
            Chart(
                f"Tensile test, H = {hardening_pa:g} Pa",
                "strain",
                "von Mises stress, kPa",
                (
                    Curve("sY", [0, strain[-1]], [yield_pa / 1e3] * 2, "theory"),
                    Curve("3 mu strain", [0, yield_pa / (3 * mu)], [0, yield_pa / 1e3], "theory"),
                    Curve("engine", strain, q / 1e3),
                ),
            ),
        ),
    )


@benchmark(
    "B11",
    "Sand in triaxial compression (Drucker-Prager)",
    source="Mohr-Coulomb: s1 / s3 = (1 + sin phi) / (1 - sin phi)",
    in_tests=("",),
)
def triaxial_sand() -> Outcome:
    """Points (E 1e5 Pa, nu 0.3) with phi = 30 and 40 degrees are pressed, then sheared until they slide."""
    points = Points(LawId.DRUCKER_PRAGER, friction_angle_deg=[30.0] * 16 + [40.0] * 16)
    points.deform(np.eye(3) * 0.99)
    for _ in range(600):
        tau = points.step(np.diag([0.5, 0.5, -1.0]), dt=1e-4)
    ratio = tau[:, 2, 2] / tau[:, 0, 0]
    expected = {phi: (1 + np.sin(np.radians(phi))) / (1 - np.sin(np.radians(phi))) for phi in (30, 40)}
    return Outcome(
        tuple(
            Check.share(f"s1 / s3 at phi = {phi} degrees", ratio[place], expected=expected[phi], tolerance=1e-4)
            for phi, place in ((30, 0), (40, 31))
        )
    )


@benchmark(
    "B20",
    "Snow crushed in a box",
    source="Stomakhin 2013: stretches within [1 - theta_c, 1 + theta_s], stiffness times exp(xi (1 - Jp))",
    in_tests=("",),
)
def crushed_snow() -> Outcome:
    """A point of snow (E 1.4e5 Pa, nu 0.2, theta_c 0.025, theta_s 0.0075, xi 10) is pressed along z to 0.86."""
    points = Points(
        LawId.SNOW, E=1.4e5, nu=0.2, critical_compression=0.025, critical_stretch=0.0075, hardening_coefficient=10.0
    )
    stretch, least, most = 1.0, 1.0, 1.0
    stretches, stresses, hardenings = [], [], []
    while stretch > 0.86:
        tau = points.step(np.diag([0.0, 0.0, -0.001]))
        stretch *= 1 - 0.001
        s = np.sqrt(np.linalg.eigvalsh(points.elastic_b[0]))
        least, most = min(least, s.min()), max(most, s.max())
        stretches.append(stretch)
        stresses.append(-tau[0, 2, 2])
        hardenings.append(1 + points.state["plastic_growth"][0])
    plastic, pressure, height = np.array(hardenings), np.array(stresses), np.array(stretches)
    first = int(np.flatnonzero(plastic < 1 - 1e-6)[0])
    expected = np.minimum(1.0, height / 0.975)
    return Outcome(
        (
            Check.between("1 - theta_c minus the smallest stretch", 0.975 - least, high=1e-5),
            Check.between("largest stretch minus 1 + theta_s", most - 1.0075, high=1e-5),
            Check.share("Jp at the end", plastic[-1], expected=expected[-1], tolerance=1e-5),
            Check.between("largest step up of Jp", np.diff(plastic).max(), high=1e-6),
            Check.share(
                "stress at the end / at first crushing",
                pressure[-1] / pressure[first],
                expected=float(np.exp(10 * (plastic[first] - plastic[-1]))),
                tolerance=1e-4,
            ),
        ),
        (
            Chart(
                "Confined compression of snow",
                "stretch",
                "stress / stress at first crushing",
                (
                    Curve(
                        "exp(xi (1 - Jp))", height[first:], np.exp(10 * (expected[first] - expected[first:])), "theory"
                    ),
                    Curve("engine", height, pressure / pressure[first]),
                ),
            ),
        ),
    )


@benchmark(
    "B20b",
    "Bingham fluid in steady shear",
    source="Bingham: |s| = sqrt(2/3) sY + eta |D|, D twice the rate of deformation",
    variants={f"eta = {eta:g} Pa s": {"viscosity_pas": eta} for eta in (0.0, 5.0, 400.0)},
    in_tests=("eta = 0 Pa s", "eta = 400 Pa s"),
)
def bingham(*, viscosity_pas: float) -> Outcome:
    """A point (E 1e5 Pa, sY 300 Pa) is sheared at 2 per second until its stress is steady."""
    rate = 2.0
    points = Points(LawId.VISCOPLASTIC, yield_stress_pa=300.0, viscosity_pas=viscosity_pas)
    gradient = np.zeros((3, 3))
    gradient[0, 1] = rate
    for _ in range(3000):
        tau = points.step(gradient, dt=1e-4)
    expected = np.sqrt(2 / 3) * 300 + viscosity_pas * np.sqrt(2) * rate
    return Outcome((Check.share("|s|, Pa", deviator(tau)[1][0], expected=expected, tolerance=1e-3),))
