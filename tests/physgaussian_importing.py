"""Imports of PhysGaussian configurations and questions to their results."""

import json

from phys4dgen.formats import load_gaussians
from phys4dgen.physgaussian.configuration import Configuration
from phys4dgen.physgaussian.importing import import_physgaussian
from phys4dgen.physgaussian.placement import place, simulated
from physgaussian_scenes import CONFIGURATIONS

MODES = ("corrected", "compat")


def importing_into(folder, model):
    """What imports a configuration, by name or as a dictionary, with its files in ``folder``."""

    def run(given, mode="corrected"):
        config = folder / "config.json"
        config.write_text(json.dumps(CONFIGURATIONS[given] if isinstance(given, str) else given))
        return import_physgaussian(config, model, folder / f"scene_{mode}.yaml", mode=mode)

    return run


def of_kind(entries, kind):
    return [entry for entry in entries if entry.kind == kind]


def mentions(imported, *words):
    return any(all(word in text for word in words) for text in imported.differences)


def placed(model, name):
    config = Configuration.model_validate(CONFIGURATIONS[name])
    gaussians = load_gaussians(model / "point_cloud/iteration_30000/point_cloud.ply")
    gaussians = gaussians.subset(simulated(gaussians, config))
    return config, gaussians, place(gaussians, config)
