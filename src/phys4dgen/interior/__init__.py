"""Paper Sec. 3.3, Internal Physical Structure Discovery: fill the hollow and label it."""

from phys4dgen.interior.discover import Interior, discover_interior
from phys4dgen.interior.gaps import welded_share
from phys4dgen.interior.thickness import with_thickness

__all__ = ["Interior", "discover_interior", "welded_share", "with_thickness"]
