"""Paper Sec. 3.3, Internal Physical Structure Discovery: fill the hollow and label it."""

from phys4dgen.interior.coarsen import coarsened
from phys4dgen.interior.discover import Interior, discover_interior
from phys4dgen.interior.thickness import with_thickness

__all__ = ["Interior", "coarsened", "discover_interior", "with_thickness"]
