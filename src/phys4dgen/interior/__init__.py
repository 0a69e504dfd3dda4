"""Paper Sec. 3.3, Internal Physical Structure Discovery: fill the hollow and label it."""

from phys4dgen.interior.cross_sections import cross_section_means
from phys4dgen.interior.discover import Interior, discover_interior
from phys4dgen.interior.gaps import narrow_gaps
from phys4dgen.interior.gaussian_particles import as_lumps
from phys4dgen.interior.joined import joined_interiors
from phys4dgen.interior.thickness import with_thickness

__all__ = [
    "Interior",
    "as_lumps",
    "cross_section_means",
    "discover_interior",
    "joined_interiors",
    "narrow_gaps",
    "with_thickness",
]
