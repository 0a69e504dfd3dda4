"""Material points that the tests of the laws share."""

from validation.points import COUNT, Points, deviator

__all__ = ["COUNT", "Points", "deviator"]
