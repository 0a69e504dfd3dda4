"""Six configurations of our own that together use every key and boundary type of PhysGaussian."""

import json

import numpy as np

from phys4dgen.formats import save_gaussians
from phys4dgen.types import Gaussians

ALWAYS = {"start_time": 0.0, "end_time": 1e3}

CONFIGURATIONS = {
    "leaf": {
        "material": "jelly",
        "E": 2e6,
        "nu": 0.3,
        "density": 200,
        "g": [0.0, 0.0, 0.0],
        "grid_lim": 2,
        "n_grid": 50,
        "opacity_threshold": 0.1,
        "rpic_damping": 0.2,
        "pic_damping": 0.1,
        "grid_v_damping_scale": 0.9999,
        "substep_dt": 1e-4,
        "frame_dt": 4e-2,
        "frame_num": 30,
        "boundary_conditions": [
            {"type": "bounding_box"},
            {
                "type": "enforce_particle_translation",
                "point": [1, 1, 0.55],
                "size": [1, 1, 0.1],
                "velocity": [0, 0, 0],
                **ALWAYS,
            },
            {"type": "particle_impulse", "force": [-0.18, 0, 0], "num_dt": 2, "start_time": 0.1},
        ],
        "mpm_space_viewpoint_center": [1, 1, 1],
        "mpm_space_vertical_upward_axis": [0, 0, 1],
        "default_camera_index": -1,
        "show_hint": False,
        "init_azimuthm": 20,
        "init_elevation": 15,
        "init_radius": 3,
        "move_camera": True,
        "delta_a": -1.0,
        "delta_e": 0.5,
        "delta_r": 0.0,
    },
    "coin": {
        "material": "metal",
        "E": 1e6,
        "nu": 0.3,
        "density": 1000,
        "g": [0, 0, -9.8],
        "yield_stress": 2e4,
        "hardening": 1,
        "xi": 0.1,
        "scale": 0.8,
        "additional_material_params": [
            {"point": [1, 1, 1.3], "size": [1, 1, 0.2], "E": 4e6, "nu": 0.2, "density": 500},
            {"point": [1, 1, 0.6], "size": [1, 1, 0.1], "E": 2e5, "nu": 0.4},
            {"point": [0.1, 0.1, 0.1], "size": [0.01, 0.01, 0.01], "E": 2e5, "nu": 0.4},
        ],
        "boundary_conditions": [
            {
                "type": "surface_collider",
                "point": [1, 1, 0.5],
                "normal": [0, 0, 1],
                "surface": "sticky",
                "friction": 0,
                **ALWAYS,
            },
            {
                "type": "cuboid",
                "point": [1, 1, 1.6],
                "size": [0.5, 0.5, 0.1],
                "velocity": [0, 0, -0.5],
                "start_time": 0.1,
                "end_time": 0.5,
                "reset": 1,
            },
        ],
        "default_camera_index": 1,
    },
    "heap": {
        "material": "sand",
        "E": 1e7,
        "nu": 0.2,
        "density": 2000,
        "g": [0, 0, -9.8],
        "friction_angle": 35,
        "rotation_degree": [90, 30],
        "rotation_axis": [0, 2],
        "sim_area": [-1, 1, -1, 1, -0.9, 1],
        "boundary_conditions": [
            {
                "type": "surface_collider",
                "point": [1, 1, 0.6],
                "normal": [0, 0.6, 0.8],
                "surface": "separate",
                "friction": 0.5,
            },
            {
                "type": "release_particles_sequentially",
                "normal": [0, 0, 1],
                "start_position": 0.8,
                "end_position": 1.2,
                "num_layers": 20,
                "start_time": 0.0,
                "end_time": 0.5,
            },
        ],
    },
    "cake": {
        "material": "foam",
        "E": 1e5,
        "nu": 0.45,
        "density": 300,
        "g": [0, 0, -9.8],
        "yield_stress": 500,
        "plastic_viscosity": 20,
        "frame_dt": 0.04,
        "substep_dt": 2e-5,
        "particle_filling": {
            "n_grid": 200,
            "density_threshold": 4.0,
            "search_threshold": 2.0,
            "max_particles_num": 2000000,
            "max_partciels_per_cell": 2,
            "search_exclude_direction": 5,
            "ray_cast_direction": 4,
            "boundary": [0.5, 1.5, 0.5, 1.5, 0.5, 1.5],
            "smooth": False,
            "visualize": False,
        },
        "boundary_conditions": [
            {"type": "surface_collider", "point": [1, 1, 0.5], "normal": [0, 0, 2], "surface": "slip", "friction": 0.2},
            {
                "type": "enforce_particle_velocity_rotation",
                "point": [1, 1, 1],
                "normal": [0, 0, 1],
                "half_height_and_radius": [0.2, 0.3],
                "rotation_scale": 2.0,
                "translation_scale": 0.1,
                **ALWAYS,
            },
        ],
    },
    "clay": {
        "material": "plasticine",
        "E": 1e5,
        "nu": 0.3,
        "density": 1500,
        "g": [0, -9.8, 0],
        "yield_stress": 1000,
        "softening": 200,
        "rotation_degree": [-90],
        "rotation_axis": [0],
        "mpm_space_vertical_upward_axis": [0, 1, 0],
        "show_hint": True,
        "boundary_conditions": [
            {"type": "surface_collider", "point": [1, 1, 1], "normal": [0, 1, 0], "surface": "cut", "friction": 0},
            {"type": "bounding_box", "start_time": 0.0, "end_time": 0.5},
        ],
    },
    "ball": {
        "material": "snow",
        "E": 1.4e5,
        "nu": 0.2,
        "density": 400,
        "g": [0, 0, -9.8],
        "boundary_conditions": [
            {"type": "cuboid", "point": [1, 1, 0.4], "size": [1, 1, 0.12], "velocity": [0, 0, 0], **ALWAYS, "reset": 0},
            {
                "type": "particle_impulse",
                "force": [0, 0, -1e-4],
                "num_dt": 100,
                "point": [1, 1, 1.4],
                "size": [1, 1, 0.2],
            },
        ],
    },
}


def write_model(folder, *, count=4000, seed=0):
    """A model folder as training leaves it: an egg, an older iteration, two cameras."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points = points * [0.6, 0.45, 0.9] + [0.2, -0.1, 0.3]
    quats = rng.normal(size=(count, 4))
    gaussians = Gaussians(
        means=points.astype(np.float32),
        quats_wxyz=(quats / np.linalg.norm(quats, axis=1, keepdims=True)).astype(np.float32),
        scales=np.full((count, 3), 0.02, np.float32),
        opacities=np.where(np.arange(count) % 10, 0.9, 0.05).astype(np.float32),
        sh=rng.normal(0, 0.5, (count, 1, 3)).astype(np.float32),
    )
    for iteration in (7000, 30000):
        place = folder / "point_cloud" / f"iteration_{iteration}"
        place.mkdir(parents=True)
        written = gaussians if iteration == 30000 else gaussians.subset(np.arange(5))
        save_gaussians(written, place / "point_cloud.ply")
    cameras = [{"id": 0, "position": [0, -3, 0]}, {"id": 1, "position": [3.2, -0.1, 0.3]}]
    (folder / "cameras.json").write_text(json.dumps(cameras))
    return gaussians
