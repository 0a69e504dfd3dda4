"""Bodies that the tests of the MPM engine share."""

from validation.bodies import body, lattice

__all__ = ["body", "lattice"]
