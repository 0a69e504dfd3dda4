"""The one public face: every name is there, and importing the package costs nothing."""

import subprocess
import sys

import pytest

import phys4dgen


def test_every_public_name_resolves():
    for name in phys4dgen.__all__:
        assert getattr(phys4dgen, name).__name__ == name
    assert dir(phys4dgen) == sorted(phys4dgen.__all__)
    with pytest.raises(AttributeError, match="no attribute 'simulate_everything'"):
        _ = phys4dgen.simulate_everything


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, phys4dgen; print({'numpy', 'numba', 'pydantic', 'rich', 'PIL'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
